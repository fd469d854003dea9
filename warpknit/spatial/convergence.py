"""Convergence of a spatial mesh: its residual, whether an equilibrium is stable, and which wires lie in each other, in words."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from .. import measure
from ..base.errors import ModelError
from ..base.text import engineering, place_text
from ..kernels.banded_mass import HELD_NODE
from ..measure.strain import strain_text
from ..mechanics.numerics import ENERGY_FLOOR, FASTEST_DAMPING, FORCE_FLOOR, LOCAL_ALLOWANCE
from ..scene import Scene
from ..wires.overlaps import CLOSEST
from .contact_arrays import Contacts
from .contact_checks import ContactSums
from .contact_multipliers import ContactMultipliers
from .model import SpatialModel
from .observables import SpatialObservables
from .rod_checks import StateSums
from .rod_relaxation import CHECK_STEPS, RodRelaxation
from .rods import Rods
from .strip import RodStrip
from .wire_contact import WireContact

ROUND_OFF = 1e5  # of EA: smallest dead load with an equilibrium within the tolerance
DISTURBANCE, SEED = 0.03, 1  # of the thickness times the residual tolerance: standard deviation of the displacements
DAMPING = 0.02  # over a step, of the motion that follows
LEAST_CHECKS, MOST_CHECKS = 8, 80  # convergence checks of that motion
GROWN = 4.0  # kinetic energy over the least so far, by which the disturbance has grown
CLAMPED = 1e-9  # of the thickness: smaller overlaps of clamped wires are rounding
MOST_LISTED = 20  # places in a message
LEAST_DIFFERENCE = 0.005  # of the scene's stiffness: a change in three digits


class Residual:
    """Residual of the state last evaluated, which says how far that is from equilibrium; converged where its ratio is below 1."""

    def __init__(self, model: SpatialModel, relaxation: RodRelaxation, multipliers: ContactMultipliers | None) -> None:
        """multipliers: of the contacts, where there are any."""
        self.model, self.relaxation, self.multipliers = model, relaxation, multipliers
        self.tolerance = model.scene.solver.residual_tolerance
        self._scale = np.full(relaxation.stepper.worlds, np.inf)  # [world] [N] reference force at the last check

    def ratio(self, state: StateSums, contacts: ContactSums, rows: np.ndarray) -> np.ndarray:
        """[row] the largest criterion over its tolerance: residual, and errors of softened axial strain and soft contacts."""
        ratio = np.maximum(self.measure(state, contacts, rows) / self.tolerance, state.excess_ratio)
        return ratio if self.multipliers is None else np.maximum(ratio, self.multipliers.error_ratio(contacts))

    def _least_force(self, of_knit: float, rows: np.ndarray) -> np.ndarray:
        """Least reference force of residuals [row] [N]: the knit's, or a smaller dead load."""
        load, model = self.relaxation.stepper.steering.dead_load[rows], self.model
        round_off = float(np.finfo(wp.dtype_to_numpy(model.precision.real)).eps)
        smallest = ROUND_OFF * round_off * float(model.rods.of_wires("axial_stiffness").max())
        return np.where(load == 0.0, of_knit, np.minimum(of_knit, np.maximum(load, smallest)))

    def measure(self, state: StateSums, contacts: ContactSums, rows: np.ndarray) -> np.ndarray:
        """[row] the larger of the relative unbalanced force and the relative motion, compared with solver.residual_tolerance.

        Sums of the state last evaluated.
        """
        relaxation, scene = self.relaxation, self.model.scene
        bent = self.model.bending_stiffness / scene.knit.wale_spacing
        scale = np.maximum(contacts.mean_push, self._least_force(FORCE_FLOOR * bent / scene.knit.wale_spacing, rows))
        self._scale[rows] = scale
        rms = np.sqrt(state.unbalanced_square / max(state.free_nodes, 1))
        stepper = relaxation.stepper
        loops = stepper.strip.whole.node_count / stepper.worlds / scene.model.nodes_per_loop
        motion = np.sqrt(relaxation.kinetic_energy(rows) / np.maximum(state.energy, ENERGY_FLOOR * bent * loops))
        return np.maximum(np.maximum(rms / scale, state.unbalanced_max / LOCAL_ALLOWANCE / scale), motion)

    def moving_blocks(self, world: int) -> int:
        """Blocks of nodes of a world that a residual far above its tolerance moves."""
        limit = CHECK_STEPS * LOCAL_ALLOWANCE * self.tolerance * float(self._scale[world])  # of the sum since the check before
        return self.relaxation.checks.unbalanced_blocks(limit, world)


class Stability:
    """Tests the stability of equilibria, level by level, in every world: a disturbance must not grow.

    A symmetric mesh may follow a path of equilibria beyond its buckling load: forces balance, but any disturbance grows. Damping
    of the stable motion hides it, because the growth is then slow. So the nodes of a converged mesh are moved at random and
    released with little damping: a stable mesh swings about its equilibrium and loses energy, an unstable one gains kinetic
    energy until it has left. Then it is relaxed again.
    """

    KEPT = ("_checks", "_energy", "_least", "_is_over", "has_left")

    def __init__(self, model: SpatialModel, relaxation: RodRelaxation, contact: WireContact) -> None:
        self.model, self.relaxation, self.contact = model, relaxation, contact
        worlds = relaxation.stepper.worlds
        self._checks = np.zeros(worlds, dtype=int)  # [world] since the disturbance of this level
        self._energy, self._least = np.full((2, worlds), np.inf)  # [J] kinetic energy at the last of them, and the least so far
        self._is_over = np.ones(worlds, dtype=bool)
        self.has_left = np.zeros(worlds, dtype=bool)  # whether a mesh has left an equilibrium that was not stable, in this level

    def begin(self, world: int = 0) -> None:
        """Test the next equilibrium that is found."""
        self._checks[world], self._least[world], self._is_over[world], self.has_left[world] = 0, np.inf, False, False

    @property
    def is_running(self) -> np.ndarray:
        """[world] whether the mesh moves as disturbed."""
        return (self._checks > 0) & ~self._is_over

    def after_check(self, ratio: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """[row] the residual ratio of a check, infinite while a mesh is tested; starts, continues and ends tests."""
        tests = ~(self._is_over[rows] | ((self._checks[rows] == 0) & (ratio >= 1.0)))
        if not tests.any():
            return ratio
        ratio, rows = ratio.copy(), rows[tests]
        ratio[tests] = np.inf
        energy, before = self.relaxation.kinetic_energy(rows), self._energy[rows]
        checks = self._checks[rows]
        if (checks == 0).any():
            self._disturb(rows[checks == 0])
        energy[checks == 0] = np.inf
        is_over = (checks > 0) & ((checks >= MOST_CHECKS) | ((checks >= LEAST_CHECKS) & (energy < before)))
        over = rows[is_over]
        self._is_over[over] = True
        self.relaxation.begin_anew(over)
        self.relaxation.stepper.steering.set(over, damping=FASTEST_DAMPING)
        self._energy[rows], self._least[rows] = energy, np.minimum(self._least[rows], energy)
        self._checks[rows] += 1
        self.has_left[rows] |= energy > GROWN * self._least[rows]
        self.hold_damping()
        return ratio

    def hold_damping(self) -> None:
        """Damp meshes little while they are tested."""
        running = np.flatnonzero(self.is_running)
        if len(running):
            self.relaxation.stepper.steering.set(running, damping=DAMPING)

    def note(self, world: int = 0) -> str:
        """Message on an unstable equilibrium."""
        strains = strain_text(self.relaxation.stepper.steering.gradient[world])
        return f"the equilibrium at strains of {strains} was unstable: the mesh snapped through to another"

    def _disturb(self, rows: np.ndarray) -> None:
        stepper = self.relaxation.stepper
        strip = stepper.strip
        nodes = strip.whole.node_count // stepper.worlds
        size = DISTURBANCE * self.model.scene.solver.residual_tolerance * strip.whole.section.thickness
        shift = size * np.random.default_rng(SEED).standard_normal((nodes, 3))
        here = strip.nodes_of_mesh if stepper.worlds == 1 else np.arange(nodes)
        free = self.relaxation.free.reshape(stepper.worlds, -1)[rows]
        place = stepper.state.displacement
        stepper.store_rows(place, rows, stepper.by_world(place)[rows] + np.where(free[..., None], shift[here], 0.0))
        self.contact.search(rows)
        self.relaxation.reset_damping_estimate(rows)


def refuse_intersecting_centre_lines(near: Contacts, rods: Rods, strip: RodStrip, instead: str) -> None:
    """Refuse centre lines that intersect: neither wire lies above. Raises `ModelError` on all ranks.

    near: contacts of the strip as knitted, of any gap below zero at least. instead: `parting_text` of the scene.
    """
    distance = 1.0 - near.overlap / rods.touch_distance(near.first, near.second)
    nodes = np.stack([near.first, near.second], axis=1)
    arc = rods.arc[nodes] + near.place * rods.natural_arc[nodes]
    where = rods.position[near.first] + near.place[:, :1] * rods.rest_edge[near.first]
    found = [
        (strip.wire[rods.wire_of[nodes[k]]].tolist(), arc[k].tolist(), where[k], float(distance[k]))
        for k in np.flatnonzero(distance < CLOSEST)
    ]
    places: list[tuple[list[int], list[float], np.ndarray, float]] = []
    for place in sorted((one for of_rank in strip.ranks.everyone(found) for one in of_rank), key=lambda one: one[3]):
        if all(np.linalg.norm(place[2] - other[2]) > rods.section.thickness for other in places):
            places.append(place)
    if not places:
        return
    texts = [_intersection_text(*place[:3]) for place in sorted(places, key=lambda one: (one[0], one[1]))]
    more = f"; and in {len(texts) - MOST_LISTED} more places" if len(texts) > MOST_LISTED else ""
    raise ModelError(f"{'; '.join(texts[:MOST_LISTED])}{more}; {instead}")


def parting_text(scene: Scene) -> str:
    """What parts intersecting centre lines: of a knit another spacing, of drawn wires another drawing."""
    if scene.wires is not None or scene.hook is not None:
        return "move one of them up or down there, or cut it"
    direction = "courses" if scene.knit.course_spacing > scene.knit.wale_spacing else "wales"
    return f"use more {direction} per length, or other chains"


def _intersection_text(wires: list[int], arcs: list[float], place: np.ndarray) -> str:
    """Intersecting wires, or places along a single one, in words."""
    near = f"near {place_text(*place[:2])}"
    if wires[0] != wires[1]:
        return f"the centre lines of wires {wires[0] + 1} and {wires[1] + 1} intersect {near}"
    along = " and ".join(engineering(arc, "m", 4) for arc in sorted(arcs))
    return f"the centre line of wire {wires[0] + 1} intersects itself {near}, {along} along it"


def refuse_overlapping_clamps(near: Contacts, rods: Rods, strip: RodStrip) -> None:
    """Wires that overlap where both are clamped cannot part. Raises `ModelError` on all ranks.

    near: contacts of the strip as knitted, of any gap below zero at least.
    """
    held = (rods.held & int(HELD_NODE)) != 0
    rigid = held & held[rods.following]
    overlap = near.overlap * (rigid[near.first] & rigid[near.second])
    worst = int(overlap.argmax()) if len(overlap) else None
    here = (0.0, 0, 0, np.zeros(3))
    if worst is not None:
        wires = strip.wire[rods.wire_of[[near.first[worst], near.second[worst]]]]
        here = (float(overlap[worst]), *wires.tolist(), rods.position[near.first[worst]])
    most, first, second, (x, y, _) = max(strip.ranks.everyone(here), key=lambda there: there[0])
    if most > CLAMPED * rods.section.thickness:
        raise ModelError(
            f"{wires_text(first + 1, second + 1)} overlap by {engineering(most, 'm')} where both are clamped, near"
            f" {place_text(x, y)}; move their ends apart, or set a smaller wire.diameter"
        )


def wires_text(first: int, second: int) -> str:
    """Two wires, or two parts of one."""
    return f"wires {first} and {second}" if first != second else f"two parts of wire {first}"


def overlap_text(observed: SpatialObservables, penalty: np.ndarray, stretch: np.ndarray) -> str:
    """Deepest overlap in words: wires, place, and a changed stiffness there.

    penalty [node] [N/m] of contacts, stretch [node] [N] softened axial stiffness: those now.
    """
    model, contacts = observed.model, observed.touching
    if not len(contacts.overlap):
        return "apart by now"
    worst = int(np.argmax(contacts.overlap))
    nodes = contacts.first[worst], contacts.second[worst]
    first, second = (int(model.rods.wire_of[node]) for node in nodes)
    place = place_text(*measure.positions(observed)[0][nodes[0], :2])
    return f"deepest now between {wires_text(first, second)} near {place} from the corner" + "".join(
        f", {name} {engineering(now, unit)} in force in place of {engineering(of_scene, unit)}"
        for name, unit, now, of_scene in (
            ("contact penalty", "N/m", penalty[list(nodes)].mean(), model.contact_stiffness),
            ("axial stiffness", "N", stretch[nodes[0]], model.rods.of_nodes("axial_stiffness")[nodes[0]]),
        )
        if not math.isclose(now, of_scene, rel_tol=LEAST_DIFFERENCE)
    )
