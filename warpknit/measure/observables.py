"""Observables of a state on the host: the same names in the planar and the spatial model.

A model offers these (planar/observables.py, spatial/observables.py); values derived from them are in measure/__init__.py.
Measures, frames, history.csv, summary.json, maps, trades and reports use only these. None: the model has none of it. A place
where the knit hooks two wires into each other is a body with two pairs, one for each wire.

Contact places, planar: one place for each body with two active pairs, with the mean of their forces. Spatial: one place for every
contact, inside and outside the hooks of the knit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..compute.ranks import Ranks
from ..knit.cloth import Cloth
from ..mesh.panel import Panel
from ..results.finding import ResultWarning
from ..results.frame import WireLayout
from ..results.row import Row
from ..scene import Scene

LEAST_SHARE = 0.5  # smallest share of a tile inside the outline with values


@dataclass(frozen=True)
class SheetPlaces:
    """Mean places of the wires of each stitch, from the panel's centre."""

    cell: np.ndarray  # (2,) [m] size of a cell at rest
    rest: np.ndarray  # (cell, 2) [m]
    now: np.ndarray  # (cell, 3) [m]; out of the plane from where they are at rest


@dataclass(frozen=True)
class PanelMap:
    """Values on tiles (column, row); nan where less than LEAST_SHARE of the tile is mesh."""

    low: np.ndarray  # (2,) [m] lower corner of the first tile, from the centre of the panel at rest
    tile: np.ndarray  # (2,) [m] size of a tile at rest
    inside: np.ndarray  # share of the tile inside the outline
    gradient: np.ndarray  # (column, row, 2, 2) deformation gradient
    nominal: np.ndarray  # (column, row, 2, 2) [N/m] force per rest width
    tension: np.ndarray  # (column, row, 2, 2) [N/m] force per current width
    active_percent: np.ndarray  # of the pairs of the tile
    stress_max: np.ndarray  # [Pa]
    sheet: SheetPlaces | None = None  # None: of a mesh that stays in its plane

    @property
    def known(self) -> np.ndarray:
        """Whether a tile has values."""
        return self.inside >= LEAST_SHARE

    @property
    def place(self) -> np.ndarray:
        """(column, row, 2) [m] centre of each tile, from the centre of the panel at rest."""
        column, row = np.indices(self.inside.shape)
        return self.low + (np.stack([column, row], axis=-1) + 0.5) * self.tile

    def area_share(self, below: np.ndarray) -> float:
        """Share of the area with values where a condition (column, row) holds."""
        area = np.where(self.known, self.inside, 0.0)
        return float(area[below & self.known].sum() / area.sum())


@dataclass(frozen=True)
class ContactPlaces:
    """Places where two wires of a periodic mesh touch. Arrays (place, 2) are of both wires."""

    force: np.ndarray  # [place] [N]
    wire: np.ndarray  # (place, 2)
    arc: np.ndarray  # (place, 2) [m] along the wire from its first node
    rest: np.ndarray  # (place, 2, 2) [m] rest position, in the repeat of the wire
    reach: np.ndarray  # (place, 2) [m] at rest, from the first wire to the second, which may lie in another repeat
    wire_length: np.ndarray  # [wire] [m]
    wire_period: np.ndarray  # (wire, 2) [m] at rest, shift of a wire to its own continuation


def arcs_along(lengths: np.ndarray, first: np.ndarray, wire: np.ndarray, node: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Arcs [m] along the wire of places at a share of the segments behind nodes. lengths [node] of segments."""
    before = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.asarray(before[node] - before[first[wire]] + share * lengths[node])


@dataclass(frozen=True)
class HookContact:
    """One state of a hook."""

    displacement: float  # [m] of the driven end
    drive_force: float  # [N] that holds it there, sideways
    force_left: float  # [N] between body and left wire
    force_right: float
    arc_left: float  # [m] rest arc length of the contact from the lower clamp
    arc_right: float
    ground_force: float  # [N] of spring or plane on the body; 0 for a free body
    body: np.ndarray  # (2,) [m]
    threshold: float  # [N] above which a contact is active

    @property
    def is_closed(self) -> bool:
        return min(self.force_left, self.force_right) > self.threshold


@dataclass(frozen=True)
class Energies:
    """Stored and kinetic energy of the mesh [J]; `stored` is all but the kinetic."""

    stretch: float
    bend: float  # with twist and hardening
    contact: float  # with friction
    kinetic: float

    @property
    def stored(self) -> float:
        return self.stretch + self.bend + self.contact


@dataclass(frozen=True)
class WireStress:
    """Stress in the outermost fibre of the wires [Pa]."""

    node: np.ndarray  # [node]
    contact: np.ndarray  # [place] between two nodes: under a contact; in the spatial model anywhere on the segments
    contact_node: np.ndarray  # [place] node before it


class MeshModel(Protocol):
    """Interface of a model for results. Its panel has the wires and bodies, and their rest positions."""

    @property
    def scene(self) -> Scene: ...
    @property
    def cloth(self) -> Cloth | None: ...  # None for a hook, or wires from a file
    @property
    def panel(self) -> Panel: ...
    @property
    def global_model(self) -> Any: ...  # the model of the global mesh; itself on one rank
    @property
    def node_count(self) -> int: ...  # number of nodes stepped; the spatial model divides wires between clamps anew
    @property
    def pair_count(self) -> int: ...  # two for each body
    @property
    def device(self) -> str: ...
    @property
    def precision(self) -> Any: ...
    @property
    def ranks(self) -> Ranks: ...
    @property
    def bending_stiffness(self) -> float: ...  # [N m2] EI
    @property
    def contact_stiffness(self) -> float: ...  # [N/m] penalty
    @property
    def softening(self) -> float: ...  # EA over the axial stiffness of the dynamics
    @property
    def time_step(self) -> float: ...  # [s] of the unloaded mesh; 1 in a relaxation
    @property
    def added_mass(self) -> float: ...  # share of mass added by scaling
    @property
    def curve_error(self) -> float: ...  # [m] error of the rest curve between the nodes
    @property
    def when_compressed(self) -> str: ...  # behaviour under compression that the model lacks, in words
    def layout(self) -> WireLayout: ...  # layout of the wires in frames
    def warnings(self, rows: Sequence[Row]) -> Iterator[ResultWarning]: ...  # where results may not be valid


class Observables(Protocol):
    """A state of a mesh on the host, SI units, float64: `record.observables`. Shapes and units stand at each name."""

    # --- boundary (strain.py)
    @property
    def model(self) -> MeshModel: ...  # the model of this state
    @property
    def gradient(self) -> np.ndarray: ...  # (2, 2) deformation gradient of the boundary
    @property
    def clamp_rotation(self) -> float: ...  # [rad] rotation of the clamps relative to the boundary
    @property
    def stretch(self) -> np.ndarray: ...  # (2, 2) deformation gradient of the boundary without the rotation of the clamps
    @property
    def length_factor(self) -> float: ...  # 1 + alpha (T - T0) of the wires
    # --- loads
    @property
    def nominal_stress(self) -> np.ndarray: ...  # (2, 2) [N/m] work-conjugate of `gradient`: force per rest width
    @property
    def thermal_force(self) -> float: ...  # [J] derivative of the energy by the length factor of the wires
    @property
    def edge_force(self) -> np.ndarray: ...  # (clamp, 2 or 3) [N] derivative of the energy by clamp displacements
    @property
    def clamp_force(self) -> np.ndarray: ...  # [clamp] [N] magnitude of the clamp forces; empty without clamps
    @property
    def unbalanced_force(self) -> float: ...  # [N] rms residual force over free nodes and bodies
    # --- energies
    @property
    def energies(self) -> Energies: ...  # [J] stored and kinetic energy: `stretch`, `bend`, `contact`, `kinetic`, `stored`
    # --- contacts
    @property
    def pair_force(self) -> np.ndarray: ...  # [pair] [N] normal force where wires hook; pairs 2b and 2b + 1 are of body b
    @property
    def penetration(self) -> float: ...  # largest overlap over the thickness of the wire
    @property
    def pairs_at_reach_end(self) -> int: ...  # active pairs at the end of their sliding range: invalid forces
    @property
    def body_near(self) -> np.ndarray | None: ...  # [body] whether its wires touch by the distance criterion of the literature
    @property
    def contact_elsewhere(self) -> np.ndarray | None: ...  # `elsewhere_force` [contact] [N]; None in the planar model
    @property
    def elsewhere_force(self) -> np.ndarray: ...  # [contact] [N] active contacts between stitches; empty in the planar model
    @property
    def elsewhere_position(self) -> np.ndarray: ...  # (contact, 3) [m] places of these contacts in the frame of `stretch`
    @property
    def elsewhere_wires(self) -> np.ndarray: ...  # (contact, 2) the two wires of these contacts
    @property
    def contact_places(self) -> ContactPlaces: ...  # places of active contacts
    @property
    def hook_contact(self) -> HookContact | None: ...  # the contact of two hooked wires; None in a mesh
    # --- wires
    @property
    def wire_stress(self) -> WireStress: ...  # [Pa] in the outermost fibre: `node` [node], `contact` [place] between nodes
    @property
    def shear_stress(self) -> np.ndarray | None: ...  # [node] [Pa] shear stress by twist
    @property
    def axial_strain(self) -> np.ndarray: ...  # [node] mechanical axial strain of the segments, T/EA
    @property
    def plastic_strain(self) -> np.ndarray: ...  # [node] plastic strain of the outermost fibre; empty, or zero, for elastic wires
    @property
    def node_length(self) -> np.ndarray: ...  # [node] [m] wire that a node stands for
    @property
    def wire_length(self) -> float: ...  # [m] of all wires as knitted
    @property
    def wire_mass(self) -> float: ...  # [kg] of all wires
    # --- places
    @property
    def node_position(self) -> np.ndarray: ...  # (node, 3) [m] in the frame of `stretch`; planar: z is the rest height
    @property
    def body_position(self) -> np.ndarray: ...  # (body, 3) [m] in the same frame
    @property
    def corner(self) -> np.ndarray: ...  # (3,) [m] lower corner of the mesh in that frame
    @property
    def between(self) -> np.ndarray: ...  # (node, parts - 1, 3) [m] points of the curve to the next node, relative to it
    @property
    def displacement(self) -> np.ndarray: ...  # (node, 2) [m] displacement from the affine (Cauchy-Born) prediction
    @property
    def thickness(self) -> float | None: ...  # [m] of the mesh, from the lowest to the highest fibre
    @property
    def panel_map(self) -> PanelMap | None: ...  # values of each repeat; None of a mesh too small for a map
