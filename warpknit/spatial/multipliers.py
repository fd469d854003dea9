"""Augmented Lagrangian multipliers of rods: of their softened axial stiffness, and of the contacts between wires.

The dynamics may soften the axial stiffness to K. At each convergence check the multiplier of a segment, the tension offset,
removes a share of the error:

    T = offset + K (|e|/L - 1)        offset -> offset + rate K (strain of the arc - T/EA)

The strain T/EA belongs to the arc of a segment, not to its chord (kernels/rod_forces.py), over its natural length at the local
temperature (`set_thermal_strain`). Where errors stall, the rate is lowered, also of contact, and K is raised.

A contact pushes with N = k (overlap + offset). At each convergence check the offsets at its nodes grow by a share of its overlap,
until the contact carries its force without overlap. So the penalty may be soft: it follows the force, k = FORCE_PENALTY N/d, and
is at least `floor`. A soft contact is about as stiff as the loops that it connects, so it does not make the masses heavy.
Contacts that share nodes share offsets: where their overlaps stall above the tolerance, the penalty is raised.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.host import fetch, store, zeros
from ..kernels.bend import BOW
from ..kernels.contact_checks import MOST_RAISED, renew_contact_offsets
from ..kernels.rod_checks import renew_tension_offsets
from ..mechanics.numerics import AXIAL_ERROR, TYPICAL_ALLOWANCE, error_ratio
from .pair_search import MAX_OFFSET
from .rod_step import CHECK_STEPS, RodStepper
from .wire_contact import ContactSums, WireContact

MAX_RATE, MIN_RATE, RATE_TO_DAMPING = 0.5, 0.05, 0.5  # see `AxialMultipliers.rate`
PROGRESS = 0.9  # of the least residual ratio: counts as progress
# checks without progress before the rate is lowered, and to which share of it; factor by which it is raised with progress
RATE_PATIENCE, LOWERED_RATE, RAISED_RATE = 12, 0.6, 1.5
# checks without progress at the least rate after which all wires are made stiffer, by which factor, and share of the axial strain
# in the residual ratio from which on
SOFT_PATIENCE, SOFT_FACTOR, SOFT_SHARE = 24, 4.0, 0.99
# a wire is taut if its mean excess strain stays above TAUT_ERROR AXIAL_ERROR for this number of checks
TAUT_ERROR, TAUT_PROGRESS = 20.0, (0.5, 8)
# the same where axial strain is what keeps the mesh from convergence
LEADING_ERROR, LEADING_PROGRESS = 5.0, (0.5, 3)
TAUT_FACTOR = 4.0  # by which a taut wire is made stiffer: its mean excess strain has stalled
OVERLAP_ERROR = 0.004  # of the thickness: allowed overlap of a contact; penalties are raised where one stalls above its rms
FORCE_PENALTY = 20.0  # penalty over N/d: a twentieth of the thickness is the overlap of a force without offset
# shares of the floor that are kept once the load is applied, by the mean force, and no wire moves faster [thicknesses a step]
SOFTEST, LOADED, SLOW = 0.02, 0.2, 0.01


class Stalled:
    """Softened constraints that have stalled: their error stays above its tolerance.

    Errors are (world, constraint), over the convergence checks.
    """

    KEPT = ("best", "checks")

    def __init__(self, worlds: int, count: int, tolerance: float, progress: float, patience: int) -> None:
        """Progress: an error falls to the share `progress` of itself within `patience` checks."""
        self._tolerance, self._progress, self._patience = tolerance, progress, patience
        self.best = np.full((worlds, count), np.inf)  # error at the last progress
        self.checks = np.zeros((worlds, count), dtype=int)  # without progress since

    def reset(self, rows: np.ndarray) -> None:
        """Start some worlds anew."""
        self.best[rows], self.checks[rows] = np.inf, 0

    def after(self, error: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(row, constraint) whether a constraint has stalled, with the errors of a check; its count then starts anew."""
        waits = (error > self._tolerance) & (error > self._progress * self.best[rows])
        self.best[rows] = np.where(waits, self.best[rows], error)
        checks = np.where(waits, self.checks[rows] + 1, 0)
        stalled = checks >= self._patience
        self.checks[rows] = np.where(stalled, 0, checks)
        return stalled


class AxialMultipliers:
    """Offsets and softened stiffness of the segments of rods (kernels/rod_checks.py)."""

    KEPT = (
        "thermal_strain", "_has_offsets", "_rate", "_best_ratio", "_stalled", "_ratio", "_has_risen", "_excess_leads", "_taut",
        "_leading",
    )  # fmt: skip

    def __init__(self, stepper: RodStepper, softening: float, wire_stiffness: np.ndarray | None, *, correct: bool) -> None:
        """softening, wire_stiffness: see `RodRelaxation`; correct: whether offsets remove the error of the softening."""
        self._stepper = stepper
        rods, state, device, worlds = stepper.rods, stepper.state, stepper.device, stepper.worlds
        self.softened_stiffness = rods.section.axial_stiffness / softening  # [N]
        self.stored_softening = 1.0 if correct else softening  # of the energy of stretch
        self.keeps_arc_length = correct and softening != 1.0
        least: np.ndarray | float = 0.0
        if wire_stiffness is not None:  # beside a clamp the half segment inside it stretches too
            least = wire_stiffness[rods.wire_of] / (1.0 + rods.half_in_clamp / rods.natural_length)
        store(state.stretch_stiffness, np.maximum(least, rods.of_nodes("axial_stiffness") / softening))
        stepper.evaluate()
        stepper.steering.set(bow_moment=2.0 * float(BOW) if self.keeps_arc_length else 0.0)
        bow = np.zeros(rods.node_count)
        if self.keeps_arc_length:
            square, (weight, next_weight) = np.sum(fetch(state.curvature) ** 2, axis=1), rods.bow_weights
            bow = float(BOW) * (weight * square + next_weight * square[rods.following])
        # [node] of the segments, relative to the length factor
        self.thermal_strain: wp.array = zeros(rods.node_count, wp.float64, device)
        self.of_excess = {  # arguments of kernels that find errors of strain
            "bow_at_rest": wp.array(bow, dtype=wp.float64, device=device),  # excess of arcs over chords (kernels/bend.py)
            "thermal_strain": self.thermal_strain,
            "keeps_arc_length": wp.int32(self.keeps_arc_length),
        }
        self._stiffening = zeros(len(rods.wire_first), wp.float64, device)  # [wire] factor of the softened stiffness
        self._launch = stepper.launcher()
        # [world]
        self._has_offsets = np.full(worlds, self.keeps_arc_length)
        self._rate, self._best_ratio = np.full(worlds, MAX_RATE), np.full(worlds, np.inf)
        self._ratio, self._has_risen = np.full(worlds, np.inf), np.zeros(worlds, dtype=bool)
        self._stalled = np.zeros(worlds, dtype=int)  # checks without progress
        self._is_too_soft = np.zeros(worlds, dtype=bool)  # for the multipliers to converge
        self._excess_leads = np.zeros(worlds, dtype=bool)  # of all criteria, at the last check
        wires = len(rods.wire_first) // worlds  # mean excess strain of each
        self._taut = Stalled(worlds, wires, TAUT_ERROR * AXIAL_ERROR, *TAUT_PROGRESS)
        self._leading = Stalled(worlds, wires, LEADING_ERROR * AXIAL_ERROR, *LEADING_PROGRESS)

    def set_thermal_strain(self, thermal_strain: np.ndarray, world: int = 0) -> None:
        """Set the strain [node] of the natural lengths of a world beyond its length factor; the offsets apply it."""
        self._stepper.store_rows(self.thermal_strain, np.array([world]), thermal_strain)
        self._has_offsets[world] |= self._stepper.strip.ranks.any(bool(thermal_strain.any()))

    def rate(self, rows: np.ndarray) -> np.ndarray:
        """[row] share of its error that a multiplier removes at a convergence check.

        If a multiplier removes the share r of the error of a mode in each step, the mode with damping c is stable for r < c.
        Multipliers of contact and of tension together may still excite a slow mode: without progress the rate is lowered, and
        raised again with it.
        """
        return np.minimum(self._rate[rows], RATE_TO_DAMPING * CHECK_STEPS * self._stepper.steering.damping[rows])

    def monitor_progress(self, ratio: np.ndarray, excess: np.ndarray, rows: np.ndarray) -> None:
        """Lower the rate where the residual ratio [row] stalls; else raise it.

        excess: the part of the ratio that errors of axial strains have.

        Multipliers converge where the softened stiffness exceeds the negative stiffness of a snap-through (Nocedal and Wright
        2006, Numerical Optimization, 17.3: the penalty of an augmented Lagrangian). Where the axial strain makes no progress at
        the least rate, all wires are made stiffer.
        """
        self._excess_leads[rows] = excess >= SOFT_SHARE * ratio
        self._has_risen[rows] |= ratio > self._ratio[rows]
        self._ratio[rows] = ratio
        is_better = ratio < PROGRESS * self._best_ratio[rows]
        better, others = rows[is_better], rows[~is_better]
        self._best_ratio[better], self._stalled[better], self._has_risen[better] = ratio[is_better], 0, False
        self._rate[better] = np.minimum(MAX_RATE, RAISED_RATE * self._rate[better])
        self._stalled[others] += 1
        is_due = (self._rate[others] > MIN_RATE) & (self._stalled[others] >= RATE_PATIENCE)
        due, slowest = others[is_due], others[~is_due & (self._stalled[others] >= SOFT_PATIENCE)]
        lowered = due[self._has_risen[due]]
        self._rate[lowered] = np.maximum(MIN_RATE, LOWERED_RATE * self._rate[lowered])
        self._stalled[due], self._has_risen[due] = 0, False
        self._is_too_soft[slowest] = self._excess_leads[slowest]

    def reset(self, rows: np.ndarray) -> None:
        """Start with the full rate."""
        self._rate[rows], self._best_ratio[rows], self._stalled[rows], self._is_too_soft[rows] = MAX_RATE, np.inf, 0, False
        self._ratio[rows], self._has_risen[rows] = np.inf, False
        self._taut.reset(rows)
        self._leading.reset(rows)

    def renew(self, mean_excess: np.ndarray, rows: np.ndarray, *, loading: bool | np.ndarray = False) -> None:
        """Move offsets by the error of the softening; stiffen taut wires, but not while loading [row].

        mean_excess: (row, wire), see `StateSums`, of the state last evaluated.
        """
        has = self._has_offsets[rows]
        if not has.any():
            return
        stiffening = np.ones((self._stepper.worlds, mean_excess.shape[1]))
        stiffens = has & ~np.broadcast_to(loading, rows.shape)
        if stiffens.any():
            stiffening[rows[stiffens]] = self._stiffened(mean_excess[stiffens], rows[stiffens])
        self._stepper.steering.set(rows, multiplier_rate=np.where(has, self.rate(rows), 0.0))
        store(self._stiffening, stiffening.ravel())
        self._launch("offsets", renew_tension_offsets, stiffening=self._stiffening, **self.of_excess)

    def _stiffened(self, mean_excess: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(row, wire) factor of the softened axial stiffness where a wire is taut: its mean excess strain is imposed and makes no
        progress."""
        raised, leading = (stalled.after(np.abs(mean_excess), rows) for stalled in (self._taut, self._leading))
        raised |= leading & self._excess_leads[rows][:, None]
        too_soft = self._is_too_soft[rows]
        self.reset(rows[too_soft])
        return np.where(too_soft[:, None], SOFT_FACTOR, np.where(raised, TAUT_FACTOR, 1.0))


@dataclass(frozen=True)
class _OverlapArrays:
    """History of the overlaps at the nodes; [node]."""

    penalty_raised: wp.array  # factor of the penalty where overlaps have stalled
    overlap_best: wp.array  # [m] at the last progress
    overlap_checks: wp.array  # int, without progress since


class ContactMultipliers:
    """Offsets and penalties of the contacts of rods (kernels/contact_checks.py)."""

    KEPT = ("_arrays", "mean_force", "loading_factor")

    def __init__(self, contact: WireContact, floor: float, softest: float = SOFTEST) -> None:
        """floor [N/m]: smallest penalty; it is the penalty of all contacts from now on; softest: see SOFTEST."""
        rods, device = contact.stepper.rods, contact.stepper.device
        nodes = rods.node_count
        self._contact, self._floor, self._softest = contact, floor, softest
        self._state = contact.stepper.state
        self._thickness = rods.section.thickness
        self._arrays = _OverlapArrays(
            wp.full(nodes, 1.0, dtype=wp.float64, device=device),
            wp.full(nodes, np.inf, dtype=wp.float64, device=device),
            wp.zeros(nodes, dtype=wp.int32, device=device),
        )
        self._constants = {
            "force_penalty": wp.float64(FORCE_PENALTY / self._thickness),
            "allowed": wp.float64(TYPICAL_ALLOWANCE * OVERLAP_ERROR * self._thickness),
            "most_offset": wp.float64(MAX_OFFSET * self._thickness),
        }
        self.mean_force = np.zeros(contact.stepper.worlds)  # [world] [N] of the contacts
        self.loading_factor = np.ones(contact.stepper.worlds)  # [world] of the penalty while a load is applied
        store(self._state.contact_penalty, floor)

    @property
    def raised(self) -> np.ndarray:
        """[node] factor of the penalty where overlaps have stalled."""
        return fetch(self._arrays.penalty_raised)

    @property
    def _loading_floor(self) -> np.ndarray:
        """[world] [N/m] smallest penalty while a load is applied: new contacts may have to carry as much as others at once."""
        return np.asarray(self.loading_factor * np.maximum(self._floor, FORCE_PENALTY * self.mean_force / self._thickness))

    def error_ratio(self, contacts: ContactSums) -> np.ndarray:
        """[row] overlaps over their tolerance."""
        allowed = OVERLAP_ERROR * self._thickness
        return error_ratio(contacts.overlap_square, contacts.pushing, contacts.overlap_max, allowed)

    def renew(self, contacts: ContactSums, rate: np.ndarray, rows: np.ndarray, *, loading: np.ndarray) -> None:
        """Move offsets by `rate` [row] times the overlaps, and penalties with the forces."""
        steering = self._contact.stepper.steering
        self.mean_force[rows] = np.where(contacts.mean_push > 0.0, contacts.mean_push, self.mean_force[rows])
        is_fast = loading | (steering.speed_max[rows] > SLOW * self._thickness)
        of_force = FORCE_PENALTY * self.mean_force[rows] / self._thickness
        soft = np.clip(of_force, self._softest * self._floor, LOADED * self._floor)
        floor = np.where(is_fast, self._loading_floor[rows], soft)
        steering.set(rows, multiplier_rate=rate, penalty_floor=floor, loading=loading)
        self._contact.launch(renew_contact_offsets, self._arrays, **self._constants)

    def stiffen(self, rows: np.ndarray | None = None) -> None:
        """Raise the penalties of worlds for the next load, and reset stalled overlaps."""
        stepper, arrays = self._contact.stepper, self._arrays
        rows = stepper.rows if rows is None else rows
        for array, value in ((arrays.penalty_raised, 1.0), (arrays.overlap_best, np.inf), (arrays.overlap_checks, 0)):
            stepper.store_rows(array, rows, value)
        self.raise_to_floor(rows)

    def raise_to_floor(self, rows: np.ndarray) -> None:
        """Raise the penalties of worlds for contacts that close fast; the forces of the offsets are kept."""
        stepper, state = self._contact.stepper, self._state
        before, offset = (stepper.by_world(array)[rows] for array in (state.contact_penalty, state.contact_offset))
        penalty = np.maximum(before, self._loading_floor[rows, None])
        stepper.store_rows(state.contact_offset, rows, offset * before / penalty)
        stepper.store_rows(state.contact_penalty, rows, penalty)

    @property
    def push(self) -> np.ndarray:
        """[node] [N] force of the contacts at a node without overlap: penalty times offset."""
        return np.asarray(fetch(self._state.contact_offset) * fetch(self._state.contact_penalty))

    def add_push(self, push: np.ndarray) -> None:
        """Add to the forces [node] [N] of the offsets."""
        penalty = np.maximum(fetch(self._state.contact_penalty), 1e-300)
        store(self._state.contact_offset, np.clip((self.push + push) / penalty, 0.0, MAX_OFFSET * self._thickness))

    def raise_to(self, penalty: np.ndarray, raised: np.ndarray, mean_force: np.ndarray) -> None:
        """Raise penalties [node] [N/m] and their factors to at least these; the forces of the offsets are kept."""
        state, push = self._state, self.push
        store(state.contact_penalty, np.maximum(fetch(state.contact_penalty), penalty))
        store(self._arrays.penalty_raised, np.clip(raised, self.raised, MOST_RAISED))
        self.mean_force = np.maximum(self.mean_force, mean_force)
        self.add_push(push - self.push)
