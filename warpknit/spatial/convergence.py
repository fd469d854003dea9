"""Stability of equilibria of a spatial mesh, remaining motion, overlapping wires in words."""

from __future__ import annotations

import math

import numpy as np

from .. import measure
from ..base.errors import ModelError
from ..base.text import engineering, place_text, short_percent
from ..compute.host import fetch
from ..mechanics.numerics import FASTEST_DAMPING
from ..scene import Scene
from ..wires.overlaps import CLOSEST
from .contact_arrays import Contacts
from .model import SpatialModel
from .observables import SpatialObservables
from .rod_relaxation import RodRelaxation
from .rods import Rods
from .strip import RodStrip
from .wire_contact import WireContact

DISTURBANCE, SEED = 0.03, 1  # of the thickness times the residual tolerance: standard deviation of the displacements
DAMPING = 0.02  # over a step, of the motion that follows
LEAST_CHECKS, MOST_CHECKS = 8, 80  # convergence checks of that motion
GROWN = 4.0  # kinetic energy over the least so far, by which the disturbance has grown
MOST_TESTS = 8  # of a level: equilibria that are left one after another
CLAMPED = 1e-9  # of the thickness: smaller overlaps of clamped wires are rounding
MOST_LISTED = 20  # places in a message
LEAST_DIFFERENCE = 0.005  # of the scene's stiffness: a change in three digits
MOTIONS = 8  # between convergence checks, from which a correction is found
LARGEST = 0.1  # of the thickness: most that a correction moves a node
INDEPENDENT = 1e-8  # least square of a direction over the largest one, of motions of length 1
POSITIVE = 1e-12  # least stiffness of a direction over the largest one


class Stability:
    """Tests the stability of equilibria, level by level, in every world: a disturbance must not grow.

    A symmetric mesh may follow a path of equilibria beyond its buckling load: forces balance, but any disturbance grows. Damping
    of the stable motion hides it, because the growth is then slow. So the nodes of a converged mesh are moved at random and
    released with little damping: a stable mesh swings about its equilibrium and loses energy, an unstable one gains kinetic
    energy until it has left. Then it is relaxed and tested again.
    """

    KEPT = ("_checks", "_energy", "_least", "_has_grown", "_tests", "has_left")

    def __init__(self, model: SpatialModel, relaxation: RodRelaxation, contact: WireContact) -> None:
        self.model, self.relaxation, self.contact = model, relaxation, contact
        worlds = relaxation.stepper.worlds
        self._checks = np.zeros(worlds, dtype=int)  # [world] since the disturbance of this level
        self._energy, self._least = np.full((2, worlds), np.inf)  # [J] kinetic energy at the last of them, and the least so far
        self._has_grown = np.zeros(worlds, dtype=bool)  # the disturbance of this test
        self._tests = np.zeros(worlds, dtype=int)  # [world] to come, with the present one
        self.has_left = np.zeros(worlds, dtype=bool)  # whether a mesh has left an equilibrium that was not stable, in this level

    def begin(self, world: int = 0) -> None:
        """Test the next equilibrium, and those that follow if it is left."""
        self._tests[world] = MOST_TESTS
        self._begin_test(world)

    def _begin_test(self, worlds: int | np.ndarray) -> None:
        self._checks[worlds], self._least[worlds], self._has_grown[worlds] = 0, np.inf, False

    @property
    def is_running(self) -> np.ndarray:
        """[world] whether the mesh moves after a disturbance."""
        return (self._checks > 0) & (self._tests > 0)

    def after_check(self, ratio: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """[row] the residual ratio of a check, infinite while a mesh is tested; starts, continues and ends tests."""
        tests = (self._tests[rows] > 0) & ((self._checks[rows] > 0) | (ratio < 1.0))
        if not tests.any():
            return ratio
        ratio, rows = ratio.copy(), rows[tests]
        ratio[tests] = np.inf
        energy, before = self.relaxation.damping.kinetic_energy(rows), self._energy[rows]
        checks = self._checks[rows]
        if (checks == 0).any():
            self._disturb(rows[checks == 0])
        energy[checks == 0] = np.inf
        is_over = (checks > 0) & ((checks >= MOST_CHECKS) | ((checks >= LEAST_CHECKS) & (energy < before)))
        self._energy[rows], self._least[rows] = energy, np.minimum(self._least[rows], energy)
        self._checks[rows] += 1
        self._has_grown[rows] |= energy > GROWN * self._least[rows]
        self.has_left[rows] |= self._has_grown[rows]
        over = rows[is_over]
        self.relaxation.begin_anew(over)
        self.relaxation.stepper.steering.set(over, damping=FASTEST_DAMPING)
        self._tests[over] = np.where(self._has_grown[over], self._tests[over] - 1, 0)
        self._begin_test(over)
        self.hold_damping()
        return ratio

    def hold_damping(self) -> None:
        """Keep the damping of tested meshes small."""
        running = np.flatnonzero(self.is_running)
        if len(running):
            self.relaxation.stepper.steering.set(running, damping=DAMPING)

    def _disturb(self, rows: np.ndarray) -> None:
        """Move the nodes of worlds at random, differently in each test."""
        stepper, strip = self.relaxation.stepper, self.relaxation.stepper.strip
        nodes = strip.whole.node_count // stepper.worlds
        size = DISTURBANCE * self.model.scene.solver.residual_tolerance * strip.whole.section.thickness
        seeds = SEED + MOST_TESTS - self._tests[rows]
        shift = size * np.stack([np.random.default_rng(seed).standard_normal((nodes, 3)) for seed in seeds.tolist()])
        here = strip.nodes_of_mesh if stepper.worlds == 1 else np.arange(nodes)
        free = stepper.rods.is_free.reshape(stepper.worlds, -1)[rows]
        place = stepper.state.displacement
        stepper.store_rows(place, rows, stepper.by_world(place)[rows] + np.where(free[..., None], shift[:, here], 0.0))
        self.contact.refresh(np.linalg.norm(shift, axis=2).max(axis=1), rows)
        self.relaxation.damping.reset(rows)


def least_energy(motions: np.ndarray, changes: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Move (unknown,) [m] to the least energy in the space of `motions` (motion, unknown) [m].

    changes (motion, unknown) [N]: of the forces during the motions; force (unknown,) [N]: now.
    """
    size = np.linalg.norm(motions, axis=1)
    motions, changes = motions[size > 0.0], changes[size > 0.0]
    if not len(motions):
        return np.zeros_like(force)
    motions, changes = (values / size[size > 0.0, None] for values in (motions, changes))
    square, vectors = np.linalg.eigh(motions @ motions.T)
    is_independent = square > INDEPENDENT * square[-1]
    basis = (vectors[:, is_independent] / np.sqrt(square[is_independent])).T
    stiffness = -basis @ (motions @ changes.T) @ basis.T
    rates, directions = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    directions = directions[:, rates > POSITIVE * np.abs(rates).max()]
    rates = rates[rates > POSITIVE * np.abs(rates).max()]
    share = directions @ (directions.T @ (basis @ (motions @ force)) / rates)
    return np.asarray((share @ basis) @ motions)


class SoftMotion:
    """Corrects the motion that remains where forces balance.

    A loose mesh, such as a swatch that hangs on the ends of its one wire, creeps or swings for thousands of steps after its
    forces balance, in fields that change the energy little. The last motions d (motion, unknown) consist of these fields. The
    forces f have changed by g during them. The energy of the mesh, moved by a . d, is to second order

        E(a) = E - a . b + a . A a/2        b = d f        A = -(d g^T + g d^T)/2

    so that A a = b in equilibrium. Directions without a least energy are left out.
    """

    KEPT = ("_motions", "_changes")

    def __init__(self, relaxation: RodRelaxation, contact: WireContact) -> None:
        self._relaxation, self._contact, self._stepper = relaxation, contact, relaxation.stepper
        self._motions: list[np.ndarray] = []  # (unknown,) [m] between successive checks
        self._changes: list[np.ndarray] = []  # (unknown,) [N]

    def _forget(self) -> None:
        self._motions, self._changes = [], []

    def collect(self, *, counts: bool) -> None:
        """Collect the motion since the last check, in the state last evaluated; if it does not count, begin anew."""
        found = self._relaxation.damping.motion() if counts else None
        if found is None:
            self._forget()
            return
        place, angle, force, torque = found
        self._motions.append(self._joined(place, angle, 1.0 / self._stepper.rods.section.thickness))
        self._changes.append(self._joined(force, torque, self._stepper.rods.section.thickness))

    def _joined(self, of_nodes: np.ndarray, of_sections: np.ndarray, lever: float) -> np.ndarray:
        """(unknown,) displacements of nodes and, with a lever [1/m], of sections; or forces, with a lever [m]."""
        return np.concatenate([of_nodes.ravel(), of_sections / lever])

    def correct(self) -> None:
        """Move the mesh to the least energy, where enough motions are collected; velocities are kept."""
        if len(self._motions) < MOTIONS:
            return
        stepper, state, rows = self._stepper, self._stepper.state, self._stepper.rows
        thickness, nodes = stepper.rods.section.thickness, stepper.rods.node_count
        force = self._joined(fetch(state.force), fetch(state.torque), thickness)
        move = least_energy(np.array(self._motions), np.array(self._changes), force)
        self._forget()
        place = move[: 3 * nodes].reshape(1, nodes, 3)
        share = min(1.0, LARGEST * thickness / max(float(np.abs(place).max()), 1e-300))
        stepper.store_rows(state.displacement, rows, stepper.by_world(state.displacement) + share * place)
        turn = share * move[None, 3 * nodes :] / thickness
        stepper.store_rows(state.pending_turn, rows, stepper.by_world(state.pending_turn) + turn)
        self._contact.search(rows)
        self._relaxation.damping.reset(rows)


def refuse_overlaps(near: Contacts, rods: Rods, strip: RodStrip, instead: str) -> None:
    """Refuse wires that cannot part: centre lines that intersect, and overlaps where both wires are clamped.

    near: contacts of the strip as knitted, of any gap below zero at least. instead: `parting_text` of the scene. Raises
    `ModelError` on all ranks.
    """
    nodes = np.stack([near.first, near.second], axis=1)
    wires, arcs = strip.wire[rods.wire_of[nodes]], rods.arc[nodes] + near.place * rods.natural_arc[nodes]
    share = near.overlap / rods.touch_distance(near.first, near.second)
    where = rods.position[near.first] + near.place[:, :1] * rods.edge_after(near.first)
    held = ~rods.is_free
    rigid = held & held[rods.following]
    is_clamped = rigid[nodes].all(axis=1) & (near.overlap > CLAMPED * rods.section.thickness)
    found = [
        (float(share[k]), wires_text(*(wires[k] + 1).tolist()), sorted(arcs[k].tolist()), where[k], bool(is_clamped[k]))
        for k in np.flatnonzero((1.0 - share < CLOSEST) | is_clamped)
    ]
    places: list[tuple[str, list[float], np.ndarray]] = []
    everywhere = sorted((one for of_rank in strip.ranks.everyone(found) for one in of_rank), key=lambda one: -one[0])
    for depth, text, arc, place, _ in everywhere:
        apart = all(np.linalg.norm(place - other[2]) > rods.section.thickness for other in places)
        if 1.0 - depth < CLOSEST and apart:
            places.append((text, arc, place))
    texts = [
        f"the centre lines of {text} intersect near {place_text(*place[:2])}"
        + (f", {' and '.join(engineering(one, 'm', 4) for one in arc)} along it" if text.startswith("two") else "")
        for text, arc, place in sorted(places, key=lambda one: one[:2])
    ]
    if texts:
        more = f"; and in {len(texts) - MOST_LISTED} more places" if len(texts) > MOST_LISTED else ""
        raise ModelError(f"{'; '.join(texts[:MOST_LISTED])}{more}; {instead}")
    for depth, text, _, place, clamped in everywhere:
        if clamped:
            raise ModelError(
                f"{text} overlap by {short_percent(depth)} of their thickness where both are clamped, near"
                f" {place_text(*place[:2])}; move their ends apart, or set a smaller wire.diameter"
            )


def parting_text(scene: Scene) -> str:
    """Advice on intersecting centre lines: another spacing of a knit, or another drawing of the wires."""
    if scene.wires is not None or scene.hook is not None:
        return "move one of them up or down there, or cut it"
    direction = "courses" if scene.knit.course_spacing > scene.knit.wale_spacing else "wales"
    return f"use more {direction} per length, or other chains"


def wires_text(first: int, second: int) -> str:
    """Two wires, or two parts of one."""
    return f"wires {first} and {second}" if first != second else f"two parts of wire {first}"


def overlap_text(observed: SpatialObservables, penalty: np.ndarray, stretch: np.ndarray) -> str:
    """Deepest overlap in words: wires, place, and a changed stiffness there.

    penalty [node] [N/m] of contacts, stretch [node] [N] softened axial stiffness: present values.
    """
    model, contacts = observed.model, observed.touching
    if not len(contacts.overlap):
        return "apart by now"
    worst = int(np.argmax(contacts.overlap))
    nodes = contacts.first[worst], contacts.second[worst]
    first, second = (int(model.rods.wire_of[node]) for node in nodes)
    place = place_text(*measure.positions(observed)[0][nodes[0], :2])
    return f"deepest now between {wires_text(first, second)} near {place} from the corner" + "".join(
        f", {name} {engineering(now, unit)} in place of {engineering(of_scene, unit)}"
        for name, unit, now, of_scene in (
            ("contact penalty", "N/m", penalty[list(nodes)].mean(), model.contact_stiffness),
            ("axial stiffness", "N", stretch[nodes[0]], model.rods.of_nodes("axial_stiffness")[nodes[0]]),
        )
        if not math.isclose(now, of_scene, rel_tol=LEAST_DIFFERENCE)
    )
