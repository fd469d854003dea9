"""Observables of a state on the host: the same names in the planar and the spatial model.

A model offers these (planar/observables.py, spatial/observables.py); values derived from them are in
measures.py. Measures, frames, history.csv, summary.json, maps, trades and reports use only these. None: the model has none
of it. A place where the knit hooks two wires into each other is a body with two pairs, one for each wire.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..compute.ranks import Ranks
from ..knit.cloth import Cloth
from ..mesh.panel import Panel
from ..results.frame import WireLayout
from ..scene import Scene
from .contact_places import ContactPlaces
from .hook_contact import HookContact
from .panel_map import PanelMap


@dataclass(frozen=True)
class Energies:
    """Stored and kinetic energy of the mesh [J]: stretch, bend (with twist and hardening), contact (with friction), kinetic.

    `stored` is the sum of the first three.
    """

    stretch: float
    bend: float  # with twist and hardening
    contact: float  # with friction
    kinetic: float

    @property
    def stored(self) -> float:
        return self.stretch + self.bend + self.contact


@dataclass(frozen=True)
class WireStress:
    """Stress in the outermost fibre of the wires [Pa].

    node              [node]
    contact           [place]     between two nodes: under a contact, in space also elsewhere on the segments
    contact_node      [place]     node before it
    """

    node: np.ndarray  # [node]
    contact: np.ndarray  # [place] between two nodes: under a contact, in space also elsewhere on the segments
    contact_node: np.ndarray  # [place] node before it


class MeshModel(Protocol):
    """What results need of a model. Its panel has the wires and bodies, and their rest positions."""

    @property
    def scene(self) -> Scene: ...
    @property
    def cloth(self) -> Cloth | None:
        """None for a hook, or wires from a file."""

    @property
    def panel(self) -> Panel: ...
    @property
    def global_model(self) -> Any:
        """The model of the global mesh; itself on one rank."""

    @property
    def node_count(self) -> int:
        """Number of nodes stepped; the spatial model divides wires between clamps anew."""

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
        """Share of mass added by scaling."""

    @property
    def curve_error(self) -> float:
        """[m] error of the rest curve between the nodes."""

    @property
    def when_compressed(self) -> str:
        """Behaviour under compression that the model lacks, in words."""

    def layout(self) -> WireLayout:
        """How wires are laid out in frames."""

    def warnings(self, stages: Sequence[dict[str, Any]]) -> Iterator[str]:
        """Warnings where results (`stages` of summary.json) may be outside the validity of the model."""


class Observables(Protocol):
    """A state of a mesh on the host, SI units, float64: `record.observables`. Shapes and units stand at each name."""

    # --- boundary (boundary.py)

    @property
    def model(self) -> MeshModel:
        """The model of this state."""

    @property
    def gradient(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary."""

    @property
    def clamp_rotation(self) -> float:
        """[rad] rotation of the clamps relative to the boundary."""

    @property
    def stretch(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary without the rotation of the clamps."""

    @property
    def length_factor(self) -> float:
        """1 + alpha (T - T0) of the wires."""

    # --- loads

    @property
    def nominal_stress(self) -> np.ndarray:
        """(2, 2) [N/m] work-conjugate of `gradient`: force per rest width."""

    @property
    def thermal_force(self) -> float:
        """[J] derivative of the energy by the length factor of the wires."""

    @property
    def thermal_strain_force(self) -> np.ndarray:
        """[J] derivative of the energy by `thermal_strain`, of its shape."""

    @property
    def thermal_strain(self) -> np.ndarray:
        """Relative excess of the length factor over that at the centre, in the layout of the model."""

    @property
    def held_forces(self) -> np.ndarray:
        """(held node, 2 or 3) [N] forces of wires and contacts on held nodes."""

    @property
    def edge_force(self) -> np.ndarray:
        """(clamp, 2, or 3 in space) [N] derivative of the energy by the displacement of the clamps."""

    @property
    def clamp_force(self) -> np.ndarray:
        """[clamp] [N] magnitude of the clamp forces; empty without clamps."""

    @property
    def unbalanced_force(self) -> float:
        """[N] rms residual force over free nodes and bodies."""

    # --- energies

    @property
    def energies(self) -> Energies:
        """[J] stored and kinetic energy: `stretch`, `bend`, `contact`, `kinetic`, `stored`."""

    @property
    def hardened_energy(self) -> float:
        """[J] hardening part of `Energies.bend`."""

    # --- contacts

    @property
    def pair_force(self) -> np.ndarray:
        """[pair] [N] normal force where the knit hooks wires; pairs 2b and 2b + 1 belong to body b."""

    @property
    def penetration(self) -> float:
        """Largest overlap over the thickness of the wire."""

    @property
    def pairs_at_reach_end(self) -> int:
        """Active pairs at the end of their sliding range, whose forces are not valid."""

    @property
    def body_near(self) -> np.ndarray | None:
        """[body] whether its wires touch by the distance criterion of the literature."""

    @property
    def contact_elsewhere(self) -> np.ndarray | None:
        """[contact] [N] `elsewhere_force`; None in the plane."""

    @property
    def elsewhere_force(self) -> np.ndarray:
        """[contact] [N] forces of active contacts outside the hooks of the knit; empty in the plane."""

    @property
    def elsewhere_position(self) -> np.ndarray:
        """(contact, 3) [m] places of these contacts in the frame of `stretch`."""

    @property
    def elsewhere_wires(self) -> np.ndarray:
        """(contact, 2) the two wires of these contacts."""

    @property
    def contact_places(self) -> ContactPlaces:
        """Places of active contacts."""

    @property
    def hook_contact(self) -> HookContact | None:
        """The contact of two hooked wires; None in a mesh."""

    # --- wires

    @property
    def wire_stress(self) -> WireStress:
        """[Pa] stress in the outermost fibre: `node` [node], and `contact` [place] between nodes."""

    @property
    def shear_stress(self) -> np.ndarray | None:
        """[node] [Pa] shear stress by twist."""

    @property
    def axial_strain(self) -> np.ndarray:
        """[node] mechanical axial strain of the segments, T/EA."""

    @property
    def plastic_strain(self) -> np.ndarray:
        """[node] plastic strain of the outermost fibre; empty, or zero, for elastic wires."""

    @property
    def node_length(self) -> np.ndarray:
        """[node] [m] wire that a node stands for."""

    @property
    def wire_length(self) -> float:
        """[m] of all wires as knitted."""

    @property
    def wire_mass(self) -> float:
        """[kg] of all wires."""

    # --- places

    @property
    def node_position(self) -> np.ndarray:
        """(node, 3) [m] in the frame of `stretch`; z is the rest height in the planar model."""

    @property
    def body_position(self) -> np.ndarray:
        """(body, 3) [m] in the same frame."""

    @property
    def corner(self) -> np.ndarray:
        """(3,) [m] lower corner of the mesh in that frame."""

    @property
    def between(self) -> np.ndarray:
        """(node, parts - 1, 3) [m] points on the curve to the next node, relative to the node (`Frame.between`)."""

    @property
    def displacement(self) -> np.ndarray:
        """(node, 2) [m] displacement from the affine (Cauchy-Born) prediction."""

    @property
    def thickness(self) -> float | None:
        """[m] of the mesh, from the lowest to the highest fibre."""

    @property
    def panel_map(self) -> PanelMap | None:
        """Strain, tension, contacts and stress of each repeat; None of a mesh too small for a map."""
