"""Augmented Lagrangian multipliers of a relaxation, for errors of softening and penalty (docs/theory/equilibrium.md).

Wires straighten under load, so the bound on their softening by their shape is updated at every level; closed wires have no
imposed chord and no bound. A short open wire whose multipliers do not converge near equilibrium is taut. Fictitious masses follow
the stiffnesses, the tension and the sharpest turn of each wire (numerics.unit_step_mass).
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import fetch, store_at
from ..compute.launch import Launch, bind
from ..kernels.multiplier_update import update_pair_offset, update_tension_offset
from ..kernels.wire_forces import BLOCK_SIZE
from ..mechanics.numerics import AXIAL_ERROR, OUTLIER_ALLOWANCE, TURN_ALLOWANCE, error_ratio
from .diagnostics import Diagnostics, Sums
from .numerics import contact_along, unit_step_mass
from .step import Stepper

BEND_OVER_STRETCH = 3.0  # smallest ratio of the compliances in bending and in softened stretch
PATIENCE = 4  # successive updates above a limit, without decrease, before a stiffness is raised
RATE = 0.4  # share of the constraint error added to a multiplier an update, at the start of a level
MIN_RATE = 0.02
RATE_PATIENCE = 10  # updates without progress before the rate is lowered, against oscillation
PENETRATION_LIMIT = 0.004  # wire diameters of overlap allowed in equilibrium
PENETRATION_STIFFEN = 0.05  # wire diameters at which the contact penalty is doubled
SMALL_MESH = 1_000  # nodes up to which every segment and contact meets the tolerance; beyond, outliers may exceed it
SOFTENING_STRAIN = 0.02  # softened axial strain at which a wire's softening is halved
TAUT_FACTOR = 4.0
TAUT_PROGRESS = 0.8  # a wire whose stretch error does not fall to this share of itself counts as taut,
TAUT_PATIENCE = 6  # in this many updates,
TAUT_NODES = 24  # nodes a loop; above, the updates grow with the square of the nodes, as bending periods do
TAUT_LENGTH = 8.0  # loops: longer wires always have slack
MASS_HEADROOM = 1.1  # an updated mass over the smallest stable one
TURNS = (TURN_ALLOWANCE, 0.5 * np.pi)  # [rad] smallest and largest turn that the masses of the rest table are made for


class Multipliers:
    """Updates the multipliers of worlds, and their stiffnesses and masses.

    The first axis of arrays counts worlds; `rows` are indices of some of them.
    """

    KEPT = (
        "rate", "_best", "_stalled", "_penetration", "_deep_updates", "_stretched_updates", "_taut_updates", "_imposed"
    )  # fmt: skip

    def __init__(self, diagnostics: Diagnostics) -> None:
        """`diagnostics` holds the tensions and strains of the last convergence check."""
        self.diagnostics, self.stepper, self.model = diagnostics, diagnostics.stepper, diagnostics.model
        self.state = self.stepper.state
        self._axial = wp.zeros_like(self.state.wire_axial)  # [world, wire] [N] stiffness after the update
        model, worlds = self.model, len(self.stepper.states)
        wires = (worlds, len(model.panel.wire_first))
        softened, h = model.axial_stiffness / model.softening, float(model.table.spacing.min())
        self._along = contact_along(model.scene)
        self._masses_at_start = [
            unit_step_mass(softened, model.bending_stiffness, model.contact_stiffness, h, turn, contact_along=self._along)
            for turn in TURNS
        ]
        self.rate = np.full(worlds, RATE)
        self._best = np.full(worlds, np.inf)
        self._stalled = np.zeros(worlds, dtype=int)  # updates without progress
        self._penetration = np.zeros(worlds)
        self._deep_updates = np.zeros(worlds, dtype=int)  # successive updates with deep penetration
        self._stretched_updates = np.zeros(wires, dtype=int)  # successive updates
        self._taut_updates = np.zeros(wires, dtype=int)  # successive updates without progress
        self._imposed = np.zeros(wires)  # mean stretch error at the last progress
        self._taut_patience = TAUT_PATIENCE * max(1.0, (model.scene.model.nodes_per_loop / TAUT_NODES) ** 2)
        self._short = (model.panel.wire_count < TAUT_LENGTH * model.scene.model.nodes_per_loop) & ~model.panel.wire_closed

    def bound_softening(self, rows: np.ndarray) -> None:
        """Bound the softening of each wire by its shape."""
        model, panel = self.model, self.model.panel
        if panel.boundary == "periodic" or not len(rows):
            return
        y = np.stack([self.diagnostics.distance_from_chord(row) for row in rows.tolist()])
        max_softening = np.maximum(1.0, y**2 * model.axial_stiffness / (BEND_OVER_STRETCH * model.bending_stiffness))
        now = self._stiffness(rows)
        axial = np.maximum(now, np.minimum(model.axial_stiffness / max_softening, model.axial_stiffness))
        rises = model.ranks.largest(np.any(axial > now * (1 + 1e-6), axis=1))
        rows, axial = rows[rises], axial[rises]
        if len(rows):
            sums = self.diagnostics.sums(rows)
            self._move_offsets(rows, axial, 0.0)
            self._renew(rows, axial, self.state.steering.contact_stiffness[rows], sums)

    def update(self, rows: np.ndarray, sums: Sums, nearly_converged: np.ndarray) -> np.ndarray:
        """Update every multiplier once; return the constraint errors [row] over their tolerance."""
        penalty = self.state.steering.contact_stiffness[rows]
        stiffer = self.renewed_axial_stiffness(self._stiffness(rows), sums, nearly_converged, rows)
        self._move_offsets(rows, stiffer, self.rate[rows])
        self._renew(rows, stiffer, self.renewed_penalty(penalty, sums, rows), sums)
        return self.residual_ratio(sums, rows)

    def _stiffness(self, rows: np.ndarray) -> np.ndarray:
        """[row, wire] [N] axial stiffness of the dynamics."""
        return np.asarray(fetch(self.state.wire_axial)[rows], dtype=np.float64)

    def _move_offsets(self, rows: np.ndarray, axial: np.ndarray, rate: np.ndarray | float) -> None:
        store_at(self._axial, rows, axial)
        self.state.steering.set(rows, multiplier_rate=rate)
        self.stepper.run(rows, self._move)

    def _move(self, stepper: Stepper, part: int) -> list[Launch]:
        """Stage of work: the update of the multipliers."""
        model, state, found = self.model, stepper.state, self.diagnostics.of_nodes[stepper.world]
        block, blocks = stepper.blocks_of(part)
        pair, pairs = stepper.team.share(model.pair_count, part)
        return [
            bind(update_pair_offset, pairs, state, first_pair=pair),
            bind(
                update_tension_offset, blocks * BLOCK_SIZE, model.mesh, state, model.constants, first_block=block,
                axial_before=state.wire_axial, axial=self._axial[stepper.world],
                tension=found["tension"], strain=found["strain"],
            ),
        ]  # fmt: skip

    def _renew(self, rows: np.ndarray, axial: np.ndarray, penalty: np.ndarray, sums: Sums) -> None:
        """Set new stiffnesses, and raise fictitious masses where the step is unstable."""
        state = self.state
        before = np.asarray(fetch(state.wire_mass)[rows], dtype=np.float64)
        mass = self.renewed_mass(before, axial, penalty, sums)
        stiffer = penalty != state.steering.contact_stiffness[rows]
        for row, value in zip(rows[stiffer].tolist(), penalty[stiffer].tolist(), strict=True):
            self.stepper.states[row].stiffen_contact(value)
        if np.any(axial != fetch(state.wire_axial)[rows]):
            store_at(state.wire_axial, rows, axial)
        if np.any(mass != before):
            store_at(state.wire_mass, rows, mass)

    # --- rules, NumPy only: what they remember from update to update

    def begin_level(self, rows: np.ndarray) -> None:
        """Reset the rate at the start of a level."""
        self.rate[rows], self._best[rows], self._stalled[rows] = RATE, np.inf, 0

    def renewed_axial_stiffness(
        self, axial: np.ndarray, sums: Sums, nearly_converged: np.ndarray, rows: np.ndarray
    ) -> np.ndarray:
        """Axial stiffness [row, wire] [N], raised where the softening is too large for the load.

        Strains are measured along the arc, because the chord of a straightening wire grows at any stiffness. Differences between
        neighbouring segments relax at once; the mean error of a wire is imposed by its ends.
        """
        imposed = sums.error_mean
        stretched = np.where(sums.strain_max > SOFTENING_STRAIN, self._stretched_updates[rows] + 1, 0)
        misses = self._short & (imposed > AXIAL_ERROR) & nearly_converged[:, None]
        stuck = misses & (imposed > TAUT_PROGRESS * self._imposed[rows])
        taut_updates = np.where(stuck, self._taut_updates[rows] + 1, 0)
        factor = np.where(stretched >= PATIENCE, 2.0, 1.0)
        factor = np.where(taut_updates >= self._taut_patience, TAUT_FACTOR, factor)
        self._stretched_updates[rows] = np.where(factor > 1.0, 0, stretched)
        self._taut_updates[rows] = np.where(factor > 1.0, 0, taut_updates)
        self._imposed[rows] = np.where(stuck, self._imposed[rows], imposed)
        return np.minimum(factor * axial, self.model.axial_stiffness)

    def renewed_penalty(self, penalty: np.ndarray, sums: Sums, rows: np.ndarray) -> np.ndarray:
        """Contact penalty [row] [N/m], doubled where penetration persists."""
        penetration = sums.gap_max / self.model.scene.wire.diameter
        deep = (penetration > PENETRATION_STIFFEN) & (penetration > 0.8 * self._penetration[rows])
        deep_updates = np.where(deep, self._deep_updates[rows] + 1, 0)
        self._deep_updates[rows] = np.where(deep_updates >= PATIENCE, 0, deep_updates)
        self._penetration[rows] = penetration
        return np.where(deep_updates >= PATIENCE, 2.0 * penalty, penalty)

    def residual_ratio(self, sums: Sums, rows: np.ndarray) -> np.ndarray:
        """Constraint error [row] over its tolerance; lowers the rate where it does not decrease."""
        segments, gap = self.model.global_model.node_count, PENETRATION_LIMIT * self.model.scene.wire.diameter
        allowance = min(max(1.0, (segments / SMALL_MESH) ** 0.25), OUTLIER_ALLOWANCE)
        ratio = np.maximum(
            error_ratio(sums.error_square, segments, sums.error_largest, AXIAL_ERROR, allowance),
            error_ratio(sums.gap_square, sums.closed, sums.gap_max, gap, allowance),
        )
        better = ratio < 0.9 * self._best[rows]
        stalled = np.where(better, 0, self._stalled[rows] + 1)
        slower = stalled >= RATE_PATIENCE
        self._best[rows] = np.where(better, ratio, self._best[rows])
        self._stalled[rows] = np.where(slower, 0, stalled)
        self.rate[rows] = np.where(slower, np.maximum(0.7 * self.rate[rows], MIN_RATE), self.rate[rows])
        return ratio

    def renewed_mass(self, mass: np.ndarray, axial: np.ndarray, penalty: np.ndarray, sums: Sums) -> np.ndarray:
        """Masses [row, wire] over the rest table, raised where `mass` is unstable."""
        model = self.model
        h, stiffness = float(model.table.spacing.min()), model.bending_stiffness
        stiffnesses = axial, stiffness, penalty[:, None], h
        slight, sharp = (unit_step_mass(*stiffnesses, turn, sums.tension_max, self._along) for turn in TURNS)
        slight_at_start, sharp_at_start = self._masses_at_start
        bent = sums.turning_max > TURN_ALLOWANCE  # possibly where the wire was straight
        needed = np.maximum(slight / slight_at_start, sharp / np.where(bent, slight_at_start, sharp_at_start))
        # the masses of the rest table have a margin for loads like the first one
        return np.where(needed > mass * MASS_HEADROOM, needed * MASS_HEADROOM, mass)
