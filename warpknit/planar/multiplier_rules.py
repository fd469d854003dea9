"""Rates of the augmented Lagrangian multipliers, and updates of stiffnesses and masses, of a relaxation (multipliers.py).

NumPy only. The same rules serve one mesh and many replicas: there the replica is the first axis of all arrays, and `rows`
selects replicas.
"""

from __future__ import annotations

from types import EllipsisType

import numpy as np

from ..mechanics.numerics import AXIAL_ERROR, OUTLIER_ALLOWANCE, TURN_ALLOWANCE, error_ratio
from .diagnostics import Sums
from .model import Model
from .numerics import contact_along, unit_step_mass

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

Rows = np.ndarray | EllipsisType


class MultiplierRules:
    """State of the rules over the updates."""

    KEPT = (
        "rate", "_best", "_stalled", "_penetration", "_deep_updates", "_stretched_updates", "_taut_updates", "_imposed"
    )  # fmt: skip

    def __init__(self, model: Model, replicas: int | None = None) -> None:
        self.model = model
        lead = () if replicas is None else (replicas,)
        wires = (*lead, len(model.panel.wire_first))
        softened, h = model.axial_stiffness / model.softening, float(model.table.spacing.min())
        self._along = contact_along(model.scene)
        self._masses_at_start = [
            unit_step_mass(softened, model.bending_stiffness, model.contact_stiffness, h, turn, contact_along=self._along)
            for turn in TURNS
        ]
        self.rate = np.full(lead, RATE)
        self._best = np.full(lead, np.inf)
        self._stalled = np.zeros(lead, dtype=int)  # updates without progress
        self._penetration = np.zeros(lead)
        self._deep_updates = np.zeros(lead, dtype=int)  # successive updates with deep penetration
        self._stretched_updates = np.zeros(wires, dtype=int)  # successive updates
        self._taut_updates = np.zeros(wires, dtype=int)  # successive updates without progress
        self._imposed = np.zeros(wires)  # mean stretch error at the last progress
        self._taut_patience = TAUT_PATIENCE * max(1.0, (model.scene.model.nodes_per_loop / TAUT_NODES) ** 2)
        self._short = (model.panel.wire_count < TAUT_LENGTH * model.scene.model.nodes_per_loop) & ~model.panel.wire_closed

    def begin_level(self, rows: Rows = ...) -> None:
        """Reset the rate at the start of a level."""
        self.rate[rows], self._best[rows], self._stalled[rows] = RATE, np.inf, 0

    def renewed_axial_stiffness(
        self, axial: np.ndarray, sums: Sums, nearly_converged: np.ndarray | bool, rows: Rows = ...
    ) -> np.ndarray:
        """Axial stiffness (..., wire) [N], raised where the softening is too large for the load.

        Strains are those of the arc, as the chord of a straightening wire grows at any stiffness. Differences between
        neighbouring segments relax at once; the mean error of a wire is imposed by its ends.
        """
        imposed = sums.error_mean
        stretched = np.where(sums.strain_max > SOFTENING_STRAIN, self._stretched_updates[rows] + 1, 0)
        misses = self._short & (imposed > AXIAL_ERROR) & np.asarray(nearly_converged)[..., None]
        stuck = misses & (imposed > TAUT_PROGRESS * self._imposed[rows])
        taut_updates = np.where(stuck, self._taut_updates[rows] + 1, 0)
        factor = np.where(stretched >= PATIENCE, 2.0, 1.0)
        factor = np.where(taut_updates >= self._taut_patience, TAUT_FACTOR, factor)
        self._stretched_updates[rows] = np.where(factor > 1.0, 0, stretched)
        self._taut_updates[rows] = np.where(factor > 1.0, 0, taut_updates)
        self._imposed[rows] = np.where(stuck, self._imposed[rows], imposed)
        return np.minimum(factor * axial, self.model.axial_stiffness)

    def renewed_penalty(self, penalty: np.ndarray, sums: Sums, rows: Rows = ...) -> np.ndarray:
        """Contact penalty (...) [N/m], doubled where penetration persists."""
        penetration = sums.gap_max / self.model.scene.wire.diameter
        deep = (penetration > PENETRATION_STIFFEN) & (penetration > 0.8 * self._penetration[rows])
        deep_updates = np.where(deep, self._deep_updates[rows] + 1, 0)
        self._deep_updates[rows] = np.where(deep_updates >= PATIENCE, 0, deep_updates)
        self._penetration[rows] = penetration
        return np.where(deep_updates >= PATIENCE, 2.0 * penalty, penalty)

    def residual_ratio(self, sums: Sums, rows: Rows = ...) -> np.ndarray:
        """Constraint error (...) over its tolerance; lowers the rate where it does not decrease."""
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
        """Masses (..., wire) over those of the rest table, raised where `mass` is unstable."""
        model = self.model
        h, stiffness = float(model.table.spacing.min()), model.bending_stiffness
        stiffnesses = axial, stiffness, np.asarray(penalty)[..., None], h
        slight, sharp = (unit_step_mass(*stiffnesses, turn, sums.tension_max, self._along) for turn in TURNS)
        slight_at_start, sharp_at_start = self._masses_at_start
        bent = sums.turning_max > TURN_ALLOWANCE  # possibly where the wire was straight
        needed = np.maximum(slight / slight_at_start, sharp / np.where(bent, slight_at_start, sharp_at_start))
        # the masses of the rest table have a margin for loads like the first one
        return np.where(needed > mass * MASS_HEADROOM, needed * MASS_HEADROOM, mass)
