"""What a state of a mesh shows on the host: the same names in the planar and the spatial model.

A model offers these (planar/observables.py, spatial/observables.py); whatever follows from them in the same way stands in
measures.py. Measures, frames, history.csv, summary.json, maps, trades and reports draw on nothing else. None: the model has none
of it. A place where the knit hooks two wires into each other is a body with two pairs, one for each wire.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..frame import WireLayout
from ..knit.cloth import Cloth
from ..mesh.panel import Panel
from ..ranks.ranks import Ranks
from ..scene import Scene
from .contact_places import ContactPlaces
from .hook_contact import HookContact
from .panel_map import PanelMap


@dataclass(frozen=True)
class Energies:
    """Stored and kinetic energy of the mesh [J]."""

    stretch: float
    bend: float  # and twist, and what wires have hardened by
    contact: float  # and friction
    kinetic: float

    @property
    def stored(self) -> float:
        return self.stretch + self.bend + self.contact


@dataclass(frozen=True)
class WireStress:
    """Stress in the outermost fibre of the wires [Pa]."""

    node: np.ndarray  # [node]
    contact: np.ndarray  # [touching pair] where bending peaks between two nodes, under a contact; empty where nodes show it


class MeshModel(Protocol):
    """What results need to know of a model. Its panel says which wires and bodies there are, and where they are at rest."""

    @property
    def scene(self) -> Scene: ...
    @property
    def cloth(self) -> Cloth | None:
        """None where wires are hooked by hand, or come from a file."""

    @property
    def panel(self) -> Panel: ...
    @property
    def global_model(self) -> Any:
        """The model of the global mesh, where ranks share it; else itself."""

    @property
    def node_count(self) -> int:
        """Nodes that are stepped; in space, wires between clamps are divided anew."""

    @property
    def pair_count(self) -> int:
        """Two for each body."""

    @property
    def device(self) -> str: ...
    @property
    def precision(self) -> Any: ...
    @property
    def ranks(self) -> Ranks: ...
    @property
    def bending_stiffness(self) -> float:
        """[N m2] EI."""

    @property
    def contact_stiffness(self) -> float:
        """[N/m] penalty."""

    @property
    def softening(self) -> float:
        """EA over the axial stiffness of the dynamics."""

    @property
    def time_step(self) -> float:
        """[s] of the unloaded mesh; 1 in a relaxation."""

    @property
    def added_mass(self) -> float:
        """Share of mass that scaling added."""

    @property
    def curve_error(self) -> float:
        """[m] of the rest curve between the nodes."""

    @property
    def when_compressed(self) -> str:
        """What a compressed mesh would do and this model does not show."""

    def layout(self) -> WireLayout:
        """How wires are laid out in frames."""

    def warnings(self, stages: Sequence[dict[str, Any]]) -> Iterator[str]:
        """Where results (`stages` of summary.json) may be beyond what the model is for, a line each."""


class Observables(Protocol):
    """A state of a mesh on the host, SI units, float64."""

    # --- boundary (boundary.py)

    @property
    def model(self) -> MeshModel:
        """What is in this state."""

    @property
    def gradient(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary."""

    @property
    def clamp_rotation(self) -> float:
        """[rad] by which the clamps are turned against the boundary."""

    @property
    def stretch(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary but for the rotation of the clamps."""

    @property
    def length_factor(self) -> float:
        """1 + alpha (T - T0) of the wires."""

    # --- loads

    @property
    def nominal_stress(self) -> np.ndarray:
        """(2, 2) [N/m] work-conjugate of `gradient`: force per rest width."""

    @property
    def thermal_force(self) -> float:
        """[J] derivative of the energy by the length factor of the wires: what heating works against."""

    @property
    def thermal_strain_force(self) -> np.ndarray:
        """[J] derivative of the energy by `thermal_strain`, of its shape."""

    @property
    def thermal_strain(self) -> np.ndarray:
        """What the length factor of the wires exceeds that in the middle by, place by place, relative; as the model has it."""

    @property
    def held_forces(self) -> np.ndarray:
        """(held node, 2, or 3 in space) [N] of the wires and of contacts on the nodes that clamps hold."""

    @property
    def edge_force(self) -> np.ndarray:
        """(clamp, 2, or 3 in space) [N] derivative of the energy by the displacement of the clamps."""

    @property
    def clamp_force(self) -> np.ndarray:
        """[clamp] [N] size of the force with which each clamp holds its wire; empty where nothing is clamped."""

    @property
    def unbalanced_force(self) -> float:
        """[N] rms over the nodes that are free, and the bodies that are."""

    # --- energies

    @property
    def energies(self) -> Energies: ...
    @property
    def hardened_energy(self) -> float:
        """[J] of `Energies.bend`, that wires have hardened by."""

    # --- contacts

    @property
    def pair_force(self) -> np.ndarray:
        """[pair] [N] normal force; pairs 2b and 2b + 1 belong to body b."""

    @property
    def penetration(self) -> float:
        """Largest overlap over the thickness of the wire."""

    @property
    def pairs_at_reach_end(self) -> int:
        """Active pairs at the end of the stretch of wire that a contact may slide on: not to be believed."""

    @property
    def body_near(self) -> np.ndarray | None:
        """[body] whether its wires are so near that they count as touching in the literature."""

    @property
    def contact_elsewhere(self) -> np.ndarray | None:
        """[contact] [N] forces of active contacts where the knit hooks nothing."""

    @property
    def contact_places(self) -> ContactPlaces:
        """Where wires touch with a force that counts."""

    @property
    def hook_contact(self) -> HookContact | None:
        """The contact of two hooked wires; None in a mesh."""

    # --- wires

    @property
    def wire_stress(self) -> WireStress: ...
    @property
    def shear_stress(self) -> np.ndarray | None:
        """[node] [Pa] by twist."""

    @property
    def axial_strain(self) -> np.ndarray:
        """[node] mechanical axial strain of the segments, T/EA."""

    @property
    def plastic_strain(self) -> np.ndarray:
        """[node] of the outermost fibre, that stays; empty where wires do not yield."""

    @property
    def wire_length(self) -> float:
        """[m] of all wires as knitted."""

    # --- places

    @property
    def node_position(self) -> np.ndarray:
        """(node, 3) [m] turned back to where the boundary is strained by `stretch`; z is the rest height in the plane."""

    @property
    def body_position(self) -> np.ndarray:
        """(body, 3) [m] in the same frame."""

    @property
    def corner(self) -> np.ndarray:
        """(3,) [m] lower corner of the mesh in that frame."""

    @property
    def between(self) -> np.ndarray:
        """(node, parts - 1, 3) [m] places on the curve to the next node, from the node, as `Frame.between` wants them."""

    @property
    def displacement(self) -> np.ndarray:
        """(node, 2) [m] from the affine (Cauchy-Born) prediction, by which the boundary carries a node."""

    @property
    def thickness(self) -> float | None:
        """[m] of the mesh, from the lowest to the highest fibre."""

    @property
    def panel_map(self) -> PanelMap | None:
        """Strain, tension, contacts and stress of each repeat; None of a mesh too small for a map."""
