"""Fields of a spatial mesh for transfer between meshes (warpknit/mechanics/), at nodes of its panel.

| field | meaning | unit |
|---|---|---|
| x, y, z | displacement of a node from the affine map of its rest position | m |
| turn | rotation of a section about its segment, beyond the tilt of its rest tangent t0 into t | rad |
| tension, strain | of a segment, and of its chord | N, - |
| push | offset of the contacts at a node times their penalty | N |

The turn does not depend on the history (kernels/rod_turns.py).
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import fetch, store, take
from ..compute.launch import bind
from ..kernels.banded_mass import HELD_NODE
from ..kernels.resample import resample_along_wires
from ..kernels.rod_turns import find_turns, turn_sections
from .contact_multipliers import ContactMultipliers
from .model import SpatialModel
from .rod_relaxation import RodRelaxation
from .wire_contact import WireContact

OF_NODES = ("x", "y", "z", "push")
OF_SEGMENTS = ("turn", "tension", "strain")
FIELDS = OF_NODES + OF_SEGMENTS
CHANGED = ("displacement", "tangent", "director", "tension_offset", "contact_offset")  # arrays of the state
STIFFNESSES = ("stretch", "penalty", "raised")  # of segments, and of contacts at nodes; not fields, as they only grow


class PanelNodes:
    """Resamples values along the wires, which rods and panel (mesh/panel.py) divide differently between clamps."""

    def __init__(self, model: SpatialModel) -> None:
        self._device = device = model.device
        panel, rods, wires = model.panel, model.rods, model.wires
        self._is_same = wires.panel_begin is None
        if wires.panel_begin is None or wires.panel_step is None:
            return

        def index(values: np.ndarray) -> wp.array:
            return wp.array(values, dtype=wp.int32, device=device)

        def real(values: np.ndarray) -> wp.array:
            return wp.array(values, dtype=wp.float64, device=device)

        rod_first, panel_first = index(rods.wire_first), index(panel.wire_first)
        self._rods_from_panel = {
            "node_wire": index(rods.wire_of),
            "wire_first": rod_first,
            "other_first": panel_first,
            "other_count": index(panel.wire_count),
            "wire_begin": real(-wires.panel_begin / wires.panel_step),
            "wire_step": real(1.0 / wires.panel_step),
        }
        self._panel_from_rods = {
            "node_wire": index(np.repeat(np.arange(len(panel.wire_first)), panel.wire_count)),
            "wire_first": panel_first,
            "other_first": rod_first,
            "other_count": index(rods.wire_count),
            "wire_begin": real(wires.panel_begin),
            "wire_step": real(wires.panel_step),
        }

    def of_rods(self, values: np.ndarray, *, of_segments: bool = False) -> np.ndarray:
        """[rod node] from values [panel node]."""
        return values if self._is_same else self._resampled(self._rods_from_panel, values, of_segments)

    def of_panel(self, values: np.ndarray, *, of_segments: bool = False) -> np.ndarray:
        """[panel node] from values [rod node]."""
        return values if self._is_same else self._resampled(self._panel_from_rods, values, of_segments)

    def _resampled(self, arrays: dict[str, wp.array], values: np.ndarray, of_segments: bool) -> np.ndarray:
        other: wp.array = wp.array(values, dtype=wp.float64, device=self._device)
        value: wp.array = wp.zeros(len(arrays["node_wire"]), dtype=wp.float64, device=self._device)
        bind(resample_along_wires, len(value), of_segments=int(of_segments), other=other, value=value, **arrays).run(self._device)
        return take(value)


class Fields:
    """Reads the fields of a mesh, and changes them."""

    def __init__(
        self, model: SpatialModel, relaxation: RodRelaxation, contact: WireContact, multipliers: ContactMultipliers
    ) -> None:
        self.model, self.relaxation, self.contact, self.multipliers = model, relaxation, contact, multipliers
        self.stepper = relaxation.stepper
        self.nodes = PanelNodes(model)
        rods = model.rods
        self._moves = (rods.held & int(HELD_NODE)) == 0
        self._turns = wp.zeros(rods.node_count, dtype=wp.float64, device=model.device)
        self._rest_director: wp.array = wp.array(rods.of_rows.director, dtype=wp.vec3d, device=model.device)

    def read(self) -> dict[str, np.ndarray]:
        """Fields [panel node] of the current state."""
        self.stepper.evaluate()
        displacement = fetch(self.stepper.state.displacement)
        values = {
            "x": displacement[:, 0],
            "y": displacement[:, 1],
            "z": displacement[:, 2],
            "push": self.multipliers.push,
            "turn": self._turn(),
            "tension": self.relaxation.tension(),
            "strain": self.relaxation.strain(),
        }
        return {name: np.array(self.nodes.of_panel(value, of_segments=name in OF_SEGMENTS)) for name, value in values.items()}

    def read_everywhere(self) -> dict[str, np.ndarray]:
        """The same of the mesh of all ranks, on each of them."""
        return {name: self._of_all_ranks(value) for name, value in self.read().items()}

    def _of_all_ranks(self, values: np.ndarray) -> np.ndarray:
        """[panel node] of the mesh of all ranks, from values of the panel here."""
        strip, panel = self.stepper.strip, self.model.panel
        if strip.is_alone:
            return values
        wires = slice(strip.wires.start, strip.wires.stop)
        begin = int(panel.wire_first[strip.wires.start])
        return np.concatenate(strip.ranks.everyone(values[begin : begin + int(panel.wire_count[wires].sum())]))

    def read_stiffness(self) -> dict[str, np.ndarray]:
        """STIFFNESSES [panel node] of the current state of the global mesh, on each rank."""
        state = self.stepper.state
        values = {
            "stretch": fetch(state.stretch_stiffness),
            "penalty": fetch(state.contact_penalty),
            "raised": self.multipliers.raised,
        }
        on_panel = {name: np.array(self.nodes.of_panel(value, of_segments=name == "stretch")) for name, value in values.items()}
        return {name: self._of_all_ranks(value) for name, value in on_panel.items()}

    def stiffen(self, stiffness: dict[str, np.ndarray], mean_force: np.ndarray) -> None:
        """Raise stiffnesses to those given [panel node]; mean_force [N] of the contacts."""
        state = self.stepper.state
        raised = {name: self.nodes.of_rods(value, of_segments=name == "stretch") for name, value in stiffness.items()}
        store(state.stretch_stiffness, np.maximum(fetch(state.stretch_stiffness), raised["stretch"]))
        self.multipliers.raise_to(raised["penalty"], raised["raised"], mean_force)

    def add(self, changes: dict[str, np.ndarray]) -> None:
        """Change the fields by values [panel node]; held nodes and sections stay. Without any change nothing moves."""
        if not self.stepper.strip.ranks.any(any(np.any(change) for change in changes.values())):
            return
        state, change = self.stepper.state, dict.fromkeys(FIELDS, np.zeros(self.model.node_count))
        for name, value in changes.items():
            change[name] = self.nodes.of_rods(value, of_segments=name in OF_SEGMENTS)
        self.stepper.evaluate()
        turn = self._turn() + np.where(self.relaxation.free_sections, change["turn"], 0.0)
        move = np.stack([change["x"], change["y"], change["z"]], axis=1)
        store(state.displacement, fetch(state.displacement) + np.where(self._moves[:, None], move, 0.0))
        self._turn_sections(turn)
        self._pull(change)
        self._begin_anew()

    def snapshot(self) -> dict[str, np.ndarray]:
        """Values changed by `add`, to restore."""
        return {name: fetch(getattr(self.stepper.state, name)).copy() for name in CHANGED}

    def put_back(self, snapshot: dict[str, np.ndarray]) -> None:
        """Return to the state of a `snapshot`, at the load of now."""
        for name in CHANGED:
            store(getattr(self.stepper.state, name), snapshot[name])
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Find the contacts of other places of the nodes, and the masses."""
        self.contact.search()
        self.relaxation.renew_masses(loading=True)
        self.relaxation.begin_anew()

    def move(self, changes: dict[str, np.ndarray]) -> None:
        """Change fields of the nodes of the rods by values [node]; held nodes and sections stay.

        The turn is that beside the rotation that a section makes with its segment.
        """
        none = np.zeros(self.model.node_count)
        move = np.stack([changes.get(name, none) for name in ("x", "y", "z")], axis=1)
        move[~self._moves] = 0.0
        self.stepper.evaluate()
        self._pull(changes)
        self.multipliers.raise_to_floor(np.array([0]))
        self.stepper.shift(move, np.where(self.relaxation.free_sections, changes.get("turn", none), 0.0))
        self.relaxation.renew_masses(loading=True)
        self.relaxation.begin_anew()

    def overlap(self) -> float:
        """Largest overlap of wires over their thickness."""
        self.contact.pop_max_penetration()
        self.stepper.evaluate()
        return float(self.contact.pop_max_penetration()[0]) / self.model.rods.section.thickness

    def _pull(self, change: dict[str, np.ndarray]) -> None:
        """Change the multipliers of segments and contacts with the fields [node]."""
        state, none = self.stepper.state, np.zeros(self.model.node_count)
        if not change.keys().isdisjoint(("tension", "strain")):
            pulled = change.get("tension", none) - fetch(state.stretch_stiffness) * change.get("strain", none)
            store(state.tension_offset, fetch(state.tension_offset) + np.where(self.relaxation.can_stretch, pulled, 0.0))
        if "push" in change:
            self.multipliers.add_push(change["push"])

    # --- turns of the sections

    def _turn(self) -> np.ndarray:
        """[node] [rad] turns of the sections, in the state last evaluated."""
        self._launch(find_turns)
        return fetch(self._turns).copy()

    def _turn_sections(self, turn: np.ndarray) -> None:
        """Set directors by the turns [node] [rad], at the tangents of the current displacements."""
        store(self._turns, turn)
        self._launch(turn_sections)

    def _launch(self, kernel: wp.Kernel) -> None:
        """Launch a kernel of kernels/rod_turns.py for all nodes."""
        sources = (self.stepper.arrays, self.stepper.state)
        bind(kernel, self.model.node_count, *sources, rest_director=self._rest_director, turn=self._turns).run(self.model.device)
