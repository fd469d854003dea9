"""Large spatial meshes: fields of their state, prolongation from smaller ones, and transfer to and from the grid of a membrane.

The fields are at the nodes of the panel (warpknit/mechanics/):

| field | meaning | unit |
|---|---|---|
| x, y, z | displacement of a node from the affine map of its rest position | m |
| turn | rotation of a section about its segment, beyond the tilt of its rest tangent t0 into t | rad |
| tension, strain | of a segment, and of its chord | N, - |
| push | offset of the contacts at a node times their penalty | N |

The turn does not depend on the history (kernels/rod_turns.py).

The grid gathers forces, and spreads displacements as cubic splines, whose slopes have no jumps: a jump would bend the wires that
cross it. Wires rotate with the membrane, and repeats change by the response of endless cloth to the strain, less so within a
repeat of the edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from scipy.spatial import cKDTree

from ..compute.host import fetch, store, store_at, take
from ..compute.launch import bind
from ..kernels.membrane_transfer import gather_forces, respond_to_strain
from ..kernels.resample import resample_along_wires
from ..kernels.rod_turns import find_turns, turn_sections
from ..kernels.wire_closest import NOT_NEAR, PLACES
from ..mechanics.grid import CountedForces, MembraneGrid
from ..mechanics.numerics import MAX_OVERLAP
from ..mechanics.prolongation import RepeatProlongation
from ..mechanics.response import Response
from .clamps import Edge, Surface
from .contact_arrays import SLIP_ARRAYS, SLIPS
from .model import SpatialModel
from .wire_contact import WireContact

OF_NODES = ("x", "y", "z", "push")
OF_SEGMENTS = ("turn", "tension", "strain", "stretch")  # the last one a stiffness
FIELDS = (*OF_NODES, *OF_SEGMENTS[:-1])
# arrays of the state, and those that are zero where it rests
CHANGED = ("displacement", "tangent", "director", "angle", "tension_offset", "contact_offset", "contact_penalty")
MOTION = ("velocity", "spin", "pending_turn")
STIFFNESSES = ("stretch", "penalty", "raised")  # of segments, and of contacts at nodes; not fields, as they only grow
MAX_SHIFT = 0.25  # of the thickness: by which a correction moves a loop against its neighbour, so that no wire passes another
LEAST_LIFT = 1.0  # thicknesses: over a panel, changes strains and contacts by far less than any tolerance


class PanelNodes:
    """Resamples values along the wires, which rods and panel (mesh/panel.py) divide differently between clamps."""

    def __init__(self, model: SpatialModel) -> None:
        panel, rods, wires = model.panel, model.rods, model.wires
        self._device, begin, step = model.device, wires.panel_begin, wires.panel_step
        self._rods_from_panel: dict[str, wp.array] = {}  # none where both have the same nodes
        self._panel_from_rods: dict[str, wp.array] = {}
        if begin is not None and step is not None:
            of_rods, of_panel = (rods.wire_first, rods.wire_count), (panel.wire_first, panel.wire_count)
            self._rods_from_panel = self._arrays(*of_rods, *of_panel, -begin / step, 1.0 / step)
            self._panel_from_rods = self._arrays(*of_panel, *of_rods, begin, step)

    def _arrays(self, first: np.ndarray, count: np.ndarray, *of_wires: np.ndarray) -> dict[str, wp.array]:
        """Arguments of the kernel: wires [wire] of the result, then of the source, with begin and step."""
        names = ("wire_first", "other_first", "other_count", "wire_begin", "wire_step", "node_wire")
        values = (first, *of_wires, np.repeat(np.arange(len(first)), count))
        kinds = (wp.int32, wp.int32, wp.int32, wp.float64, wp.float64, wp.int32)
        return {
            name: wp.array(value, dtype=kind, device=self._device) for name, value, kind in zip(names, values, kinds, strict=True)
        }

    def of_rods(self, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """[rod node] from values [panel node], by name."""
        return self._resampled(self._rods_from_panel, values)

    def of_panel(self, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """[panel node] from values [rod node], by name."""
        return self._resampled(self._panel_from_rods, values)

    def _resampled(self, arrays: dict[str, wp.array], values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        if not arrays:
            return {name: np.array(own) for name, own in values.items()}
        found, threads, device = {}, len(arrays["node_wire"]), self._device
        for name, own in values.items():
            value: wp.array = wp.zeros(threads, dtype=wp.float64, device=device)
            other: wp.array = wp.array(own, dtype=wp.float64, device=device)
            named = {"of_segments": int(name in OF_SEGMENTS), "other": other, "value": value}
            bind(resample_along_wires, threads, **named, **arrays).run(device)
            found[name] = take(value)
        return found


class Fields:
    """Reads the fields of a mesh, and changes them."""

    def __init__(self, mechanics: Any) -> None:
        """mechanics: the `SpatialMechanics` of a relaxation."""
        model: SpatialModel = mechanics.model
        self.model, self.stepper, self.contact = model, mechanics.stepper, mechanics.contact
        self.relaxation, self.multipliers = mechanics.relaxation, mechanics.multipliers
        self.nodes, rods = PanelNodes(model), model.rods
        self._turns = wp.zeros(rods.node_count, dtype=wp.float64, device=model.device)
        self._rest_director: wp.array = wp.array(rods.of_rows.director, dtype=wp.vec3d, device=model.device)

    def read(self) -> dict[str, np.ndarray]:
        """Fields [panel node] of the current state."""
        self.stepper.evaluate()
        values = dict(zip("xyz", fetch(self.stepper.state.displacement).T, strict=True))
        values |= {"push": self.multipliers.push, "turn": self._turn()}
        values |= {"tension": self.relaxation.tension(), "strain": self.relaxation.strain()}
        return self.nodes.of_panel(values)

    def read_everywhere(self) -> dict[str, np.ndarray]:
        """Fields of the mesh of all ranks, on each rank."""
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
        values = {"stretch": fetch(state.stretch_stiffness), "penalty": fetch(state.contact_penalty)}
        values["raised"] = self.multipliers.raised
        return {name: self._of_all_ranks(value) for name, value in self.nodes.of_panel(values).items()}

    def stiffen(self, stiffness: dict[str, np.ndarray], mean_force: np.ndarray) -> None:
        """Raise stiffnesses to those given [panel node]; mean_force [N] of the contacts."""
        state = self.stepper.state
        raised = self.nodes.of_rods(stiffness)
        store(state.stretch_stiffness, np.maximum(fetch(state.stretch_stiffness), raised["stretch"]))
        self.multipliers.raise_to(raised["penalty"], raised["raised"], mean_force)

    def add(self, changes: dict[str, np.ndarray]) -> None:
        """Change the fields by values [panel node]; held nodes and sections stay. Without any change nothing moves."""
        if not self.stepper.strip.ranks.any(any(np.any(change) for change in changes.values())):
            return
        state, none = self.stepper.state, np.zeros(self.model.node_count)
        change = dict.fromkeys(FIELDS, none) | self.nodes.of_rods(changes)
        self.stepper.evaluate()
        turn = self._turn() + np.where(self.model.rods.can_turn, change["turn"], 0.0)
        move = np.stack([change["x"], change["y"], change["z"]], axis=1)
        store(state.displacement, fetch(state.displacement) + np.where(self.model.rods.is_free[:, None], move, 0.0))
        store(self._turns, turn)  # directors follow, at the tangents of the new displacements
        self._launch(turn_sections)
        self._pull(change)
        self._begin_anew()

    def snapshot(self) -> dict[str, np.ndarray]:
        """Values changed by `add`, to restore."""
        return {name: fetch(getattr(self.stepper.state, name)).copy() for name in CHANGED}

    def put_back(self, snapshot: dict[str, np.ndarray]) -> None:
        """Return to the state of a `snapshot`, at the present load."""
        for name in CHANGED:
            store(getattr(self.stepper.state, name), snapshot[name])
        for name in MOTION:
            store(getattr(self.stepper.state, name), 0.0)
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Find the contacts of other places of the nodes, and the masses."""
        self.contact.search()
        self.relaxation.masses.renew(loading=True)
        self.relaxation.begin_anew()

    def move(self, changes: dict[str, np.ndarray], smooth: np.ndarray, strain: float, held: np.ndarray | None) -> None:
        """Change fields of the nodes of the rods by values [node]; held sections stay.

        The turn of a section is in addition to its rotation with the segment. smooth, strain: as of `RodStepper.shift`. held:
        (held node, 3) [m] motion of held nodes; they stay without it.
        """
        none = np.zeros(self.model.node_count)
        move = np.stack([changes.get(name, none) for name in ("x", "y", "z")], axis=1)
        move[~self.model.rods.is_free] = 0.0
        if held is not None:
            move[self.model.wires.held_node] = held
        self._pull(changes)
        self.multipliers.raise_to_floor(np.array([0]))
        self.stepper.shift(move, np.where(self.model.rods.can_turn, changes.get("turn", none), 0.0), smooth, strain)
        self.relaxation.masses.renew(loading=True)
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
            store(state.tension_offset, fetch(state.tension_offset) + np.where(self.model.rods.can_stretch, pulled, 0.0))
        if "push" in change:
            self.multipliers.add_push(change["push"])

    # --- turns of the sections

    def _turn(self) -> np.ndarray:
        """[node] [rad] turns of the sections, in the state last evaluated."""
        self._launch(find_turns)
        return fetch(self._turns).copy()

    def _launch(self, kernel: wp.Kernel) -> None:
        """Launch a kernel of kernels/rod_turns.py for all nodes."""
        sources = (self.stepper.arrays, self.stepper.state)
        bind(kernel, self.model.node_count, *sources, rest_director=self._rest_director, turn=self._turns).run(self.model.device)


def share_of_repeat(model: SpatialModel) -> np.ndarray:
    """[rod node] share of the response of endless cloth in a gripped mesh; smaller within a repeat of the edge.

    It depends on the place, not on the wire: wires that touch move together.
    """
    assert model.panel.outline is not None
    away = model.panel.outline.nearest(model.rods.position[:, :2])[1]
    return np.asarray(np.minimum(away / min(model.scene.knit.repeat), 1.0))


class Prolongation(RepeatProlongation):
    """Brings a large mesh to the state of a small one."""

    KEPT = (*RepeatProlongation.KEPT, "_before")

    def __init__(self, large: Fields, small: Fields, edge: Edge | None) -> None:
        """edge: of the large mesh."""
        super().__init__(large.model, small.model, small.read_everywhere, fades=False)
        self._fields, self._small_fields, self._edge = large, small, edge
        self._before: dict[str, np.ndarray] = {}  # state of the large mesh before the last `carry`
        self._share: np.ndarray | float = 1.0
        if self.is_periodic and large.model.panel.boundary == "gripped":
            self._share = large.nodes.of_panel({"share": share_of_repeat(large.model)})["share"]
        self._one = wp.full(len(large.model.panel.wire_first), 1.0, dtype=wp.float64, device=large.model.device)

    def carry(self, response: Response) -> bool:
        large, small = self._fields, self._small_fields
        taken, stiffness = self.taken(), small.read_stiffness()
        change = self.changes(stiffness | (self._last if taken is None else taken), wp.float64)
        raised = {name: self._prolonged(name, change, response) for name in stiffness}
        large.stiffen(raised, small.multipliers.mean_force)
        stations = {} if self._edge is None else {"stations": self._edge.station_displacement.copy()}
        self._before = large.snapshot() | stations
        if taken is None:
            return True
        own = large.read() if self.replaces else dict.fromkeys(taken, 0.0)
        large.add({name: self._share * (self._prolonged(name, change, response) - own[name]) for name in taken})
        fits = large.overlap() <= MAX_OVERLAP  # else wires may push each other through
        if fits and large.contact.friction > 0.0:
            take_elastic_slips(large.contact, *elastic_slips(small.contact), self._repeat)
        if fits and self.replaces:
            self.forget()
        return fits

    def forget(self) -> None:
        self._before = {}

    def put_back(self) -> None:
        if self._edge is not None:
            self._edge.station_displacement = self._before["stations"]
        self._fields.put_back(self._before)
        if self._fields.contact.friction > 0.0:
            take_elastic_slips(self._fields.contact, np.zeros((0, 6)), np.zeros((0, 3)), self._repeat)

    def _prolonged(self, name: str, change: dict[str, wp.array], response: Response) -> np.ndarray:
        """[panel node] of the large mesh, from values of the small one."""
        value = wp.zeros(self.large.panel.node_count, dtype=wp.float64, device=self.large.device)
        self.add_to_nodes(change, response, name, value, wire_scale=self._one, scale=wp.float64(1.0))
        return take(value)


def elastic_slips(contact: WireContact) -> tuple[np.ndarray, np.ndarray]:
    """Places of the contacts of a single world, see `_at_rest`; their elastic slips (contact, 3) [m]."""
    step, slips = int(contact.stepper.steering.step[0]), contact.slips
    which = np.flatnonzero(fetch(slips.slip_step)[step % 2, : SLIPS * contact.pair_count] == step)
    place, slip = (fetch(x)[step % 2, which] for x in (slips.slip_place, slips.elastic_slip))
    return _at_rest(contact, which // SLIPS, place), slip.copy()


def take_elastic_slips(contact: WireContact, at_rest: np.ndarray, slip: np.ndarray, repeat: np.ndarray) -> None:
    """Take over the elastic slips of one repeat, and begin an increment.

    at_rest, slip: `elastic_slips` of the repeat; repeat: its size (2,) [m]. A contact takes the slip of the nearest contact
    of the repeat at rest, within a segment.
    """
    step, pairs, near = int(contact.stepper.steering.step[0]), contact.pairs, contact.near_pairs()
    touches = fetch(contact.touch.touch_normal_force)[: PLACES * len(near)].reshape(-1, PLACES)[:, :SLIPS] != 0.0
    row, slot = np.nonzero(touches & (fetch(pairs.pair_found)[near] > int(NOT_NEAR))[:, None])
    pair = near[row]
    place = fetch(pairs.pair_place)[PLACES * pair + slot]
    # either wire of a contact may be the first one
    ways = at_rest, np.concatenate([at_rest[:, :3] + at_rest[:, 3:], -at_rest[:, 3:]], axis=1)
    size = np.array([*repeat, 0.0, 0.0, 0.0, 0.0])
    known, own = (_in_repeat(points, repeat) for points in (np.concatenate(ways), _at_rest(contact, pair, place)))
    segment = float(contact.stepper.rods.natural_length.max())
    distance, nearest = cKDTree(known, boxsize=size).query(own, distance_upper_bound=segment)
    is_known = np.isfinite(distance)
    which = (SLIPS * pair + slot)[is_known]
    values = step, place[is_known], np.concatenate([slip, -slip])[nearest[is_known]]
    store(contact.slips.slip_step, -1)
    for name, known_values in zip(SLIP_ARRAYS, values, strict=True):
        store_at(getattr(contact.slips, name), (slice(None), which), known_values)
    contact.begin_increment(np.array([0]))


def _at_rest(contact: WireContact, pair: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(contact, 6) [m] at rest: a place on the first segment of a pair, and the way from there to that on the second."""
    pairs, rods = contact.pairs, contact.stepper.rods
    first, second = (fetch(x)[pair] for x in (pairs.pair_first, pairs.pair_second))
    one, two = (rods.position[k] + place[:, n, None] * rods.edge_after(k) for n, k in enumerate((first, second)))
    return np.concatenate([one, two + fetch(pairs.pair_shift)[pair] - one], axis=1)


def _in_repeat(points: np.ndarray, repeat: np.ndarray) -> np.ndarray:
    """Points (n, 6) with their first two coordinates in one repeat."""
    inside = points.copy()
    inside[:, :2] %= repeat
    inside[:, :2][inside[:, :2] >= repeat] = 0.0  # of round-off
    return inside


class SpatialGrid(MembraneGrid):
    """A grid of `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m], over a mesh."""

    def __init__(self, fields: Fields, edge: Edge | None, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> None:
        self.fields, self.model, self._edge = fields, fields.model, edge
        self.least_lift = LEAST_LIFT * self.model.rods.section.thickness
        self.max_strain = MAX_SHIFT * self.model.rods.section.thickness / self.model.scene.knit.wale_spacing
        self._surface = Surface(low, cell, cells, fields.stepper.arrays.rest_position, self.model.device)
        count = int(np.prod(cells + 1))
        stiffness = self.model.rods.section.axial_stiffness
        self._force, self._across_force = (CountedForces(count, stiffness, self.model.device) for _ in range(2))
        panel, device = self.model.panel, self.model.device
        self._entry: wp.array = wp.array(panel.node_entry, dtype=wp.int32, device=device)
        self._share = share_of_repeat(self.model)

    def gather(self) -> np.ndarray:
        stepper = self.fields.stepper
        self._force.counts.zero_()
        self._across_force.counts.zero_()
        own = stepper.strip.nodes
        bind(
            gather_forces, len(own), stepper.arrays, stepper.state, first_node=own.start, grid=self._surface.grid,
            grid_force=self._force.counts, across_force=self._across_force.counts, force_unit=self._force.unit,
        ).run(self.model.device)  # fmt: skip
        return self._force.read(stepper.strip.ranks)

    def gather_across(self) -> np.ndarray:
        return self._across_force.read(self.fields.stepper.strip.ranks)[:, 0]

    def spread(self, displacement: np.ndarray, response: Response, stations: np.ndarray | None = None) -> None:
        x, y = self._surface.at_nodes(displacement[:, 0]), self._surface.at_nodes(displacement[:, 1])
        shear = 0.5 * (x[2] + y[1])  # sections rotate with the mesh as below
        changes = self._answer({"gradient_xx": x[1], "gradient_xy": shear, "gradient_yx": shear, "gradient_yy": y[2]}, response)
        changes["x"], changes["y"] = changes.get("x", 0.0) + x[0], changes.get("y", 0.0) + y[0]
        (along_x, along_y) = (self._on_mesh(*slope) for slope in (x[1:], y[1:]))
        rotation = 0.5 * (along_y[0] - along_x[1]) * fetch(self.fields.stepper.state.tangent)[:, 2]
        changes["turn"] = changes.get("turn", 0.0) + rotation
        smooth = self._smooth(x, y)
        del x, y, shear, along_x, along_y, rotation
        self._move(changes, *smooth, stations)

    def spread_across(self, displacement: np.ndarray, stations: np.ndarray | None = None) -> None:
        stepper, rods = self.fields.stepper, self.model.rods
        z = self._surface.at_nodes(displacement)
        along_x, along_y = self._on_mesh(*z[1:])
        height = rods.position[:, 2] - stepper.strip.whole.position[:, 2].mean()
        tangent = fetch(stepper.state.tangent)
        turn = along_y * tangent[:, 0] - along_x * tangent[:, 1]
        nothing = (np.zeros(len(turn)),) * 3
        changes = {"x": -along_x * height, "y": -along_y * height, "z": z[0], "turn": turn}
        self._move(changes, *self._smooth(nothing, nothing, z), stations)
        velocity = stepper.state.velocity
        store(velocity, fetch(velocity) * np.array([1.0, 1.0, 0.0]))

    def _smooth(self, *grid: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
        """Motion (node, 3) [m] of the grid, and the largest sum of its slopes; grid: value and slopes [node] by coordinate."""
        smooth = np.zeros((self.model.node_count, 3), dtype=np.float32)
        slopes = np.zeros(self.model.node_count)
        for k, (value, *along) in enumerate(grid):
            smooth[:, k] = value
            slopes += np.abs(along).sum(axis=0)
        return smooth, self.fields.stepper.strip.largest_of_nodes(slopes)

    def _move(self, changes: dict[str, np.ndarray], smooth: np.ndarray, strain: float, stations: np.ndarray | None) -> None:
        """Change fields of the nodes, and the edge; smooth, strain: as of `RodStepper.shift`."""
        held = None if stations is None or self._edge is None else self._edge.move(stations)
        self.fields.move(changes, smooth, strain, held)

    def _answer(self, gradient: dict[str, np.ndarray], response: Response) -> dict[str, np.ndarray]:
        """Changes of fields [node], by name, of repeats strained by the grid; gradient: [node] of the displacement."""
        nodes, panel, device = self.fields.nodes, self.model.panel, self.model.device
        of_panel: dict[str, wp.array] = {
            name: wp.array(part, dtype=wp.float64, device=device) for name, part in nodes.of_panel(gradient).items()
        }
        value, answer = wp.zeros(panel.node_count, dtype=wp.float64, device=device), {}
        for name, cell in response.change.items():
            bind(
                respond_to_strain, panel.node_count, response, node_entry=self._entry, cell=cell, value=value, **of_panel,
            ).run(device)  # fmt: skip
            answer[name] = self._share * nodes.of_rods({name: fetch(value)})[name]
        return answer

    def _on_mesh(self, slope_x: np.ndarray, slope_y: np.ndarray) -> np.ndarray:
        """(2, node) slopes on the deformed mesh, from the slopes at rest."""
        inverse = np.linalg.inv(self.fields.stepper.state.gradient)
        return np.stack([slope_x * inverse[0, k] + slope_y * inverse[1, k] for k in (0, 1)])
