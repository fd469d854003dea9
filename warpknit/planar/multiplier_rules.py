"""What decides how fast the multipliers of a relaxation move, and when stiffnesses that the load has outgrown are renewed.

NumPy only. The same rules serve one mesh and many replicas of it side by side: there the replica is the first axis of all arrays,
and `rows` picks those that a call is about. See multipliers.py for what the numbers are for.
"""

from __future__ import annotations

from types import EllipsisType

import numpy as np

from ..numerics import AXIAL_ERROR, TURN_ALLOWANCE
from .diagnostics import Sums
from .model import Model
from .numerics import contact_along, unit_step_mass

PATIENCE = 4  # updates in a row that a limit must be passed, without coming down by itself, before numbers are renewed
RATE = 0.4  # of a multiplier an update, at the start of a level
RATE_LEAST = 0.02
RATE_PATIENCE = 10  # updates without progress before the rate is lowered: wires that answer late would make it swing
PENETRATION_LIMIT = 0.004  # wire diameters that a closed pair may overlap in a steady state
PENETRATION_STIFFEN = 0.05  # wire diameters at which the contact penalty is doubled
SOFTENING_STRAIN = 0.02  # softened axial strain at which a wire's softening is halved
TAUT_FACTOR = 4.0
TAUT_PROGRESS = 0.8  # of what a wire misses, down to which it must come lest it counts as taut,
TAUT_PATIENCE = 6  # in so many updates,
TAUT_NODES = 24  # up to so many nodes a loop; above, they grow with the square of the nodes, as periods of bending do
TAUT_LENGTH = 8.0  # loops: a longer wire always has slack
MASS_HEADROOM = 1.1  # a renewed mass over the least that is stable
TURNS = (TURN_ALLOWANCE, 0.5 * np.pi)  # [rad] the least and the most that the masses of the rest table are made for

Rows = np.ndarray | EllipsisType


class MultiplierRules:
    """Carries from update to update what the rules go by."""

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
        self._waited = np.zeros(lead, dtype=int)  # updates without progress
        self._sunk = np.zeros(lead)
        self._sinking = np.zeros(lead, dtype=int)  # updates in a row with bodies sunk in
        self._stretched = np.zeros(wires, dtype=int)  # updates in a row
        self._unsettled = np.zeros(wires, dtype=int)  # updates in a row without progress
        self._imposed = np.zeros(wires)  # strain missing in the mean, as of the last progress
        self._taut_patience = TAUT_PATIENCE * max(1.0, (model.scene.model.nodes_per_loop / TAUT_NODES) ** 2)
        self._short = (model.panel.wire_count < TAUT_LENGTH * model.scene.model.nodes_per_loop) & ~model.panel.wire_closed

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""
        numbers = [self._sunk, self._sinking, self.rate, self._best, self._waited]
        return {
            "sunk": np.array(numbers, dtype=float),
            "stretched": self._stretched.copy(),
            "unsettled": self._unsettled.copy(),
            "imposed": self._imposed.copy(),
        }

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `state_dict` returned."""
        numbers = (self._sunk, self._sinking, self.rate, self._best, self._waited)
        for array, value in zip(numbers, kept["sunk"], strict=True):
            array[...] = value
        self._stretched, self._unsettled, self._imposed = (kept[name].copy() for name in ("stretched", "unsettled", "imposed"))

    def begin_level(self, rows: Rows = ...) -> None:
        """Start with the full rate again."""
        self.rate[rows], self._best[rows], self._waited[rows] = RATE, np.inf, 0

    def outgrown(self, axial: np.ndarray, sums: Sums, nearly_steady: np.ndarray | bool, rows: Rows = ...) -> np.ndarray:
        """Axial stiffness (..., wire) [N], raised where the softening is more than a wire bears.

        Strains are those of the arc: the chord of a wire that straightens grows, however stiff the wire is. A segment gives
        way to its neighbours at once; what is missing in the mean is what the ends impose.
        """
        imposed = sums.error_mean
        stretched = np.where(sums.strain_max > SOFTENING_STRAIN, self._stretched[rows] + 1, 0)
        misses = self._short & (imposed > AXIAL_ERROR) & np.asarray(nearly_steady)[..., None]
        stuck = misses & (imposed > TAUT_PROGRESS * self._imposed[rows])
        unsettled = np.where(stuck, self._unsettled[rows] + 1, 0)
        factor = np.where(stretched >= PATIENCE, 2.0, 1.0)
        factor = np.where(unsettled >= self._taut_patience, TAUT_FACTOR, factor)
        self._stretched[rows] = np.where(factor > 1.0, 0, stretched)
        self._unsettled[rows] = np.where(factor > 1.0, 0, unsettled)
        self._imposed[rows] = np.where(stuck, self._imposed[rows], imposed)
        return np.minimum(factor * axial, self.model.axial_stiffness)

    def stiffened(self, penalty: np.ndarray, sums: Sums, rows: Rows = ...) -> np.ndarray:
        """Contact penalty (...) [N/m], doubled where bodies stay sunk in."""
        sunk = sums.gap_max / self.model.scene.wire.diameter
        deep = (sunk > PENETRATION_STIFFEN) & (sunk > 0.8 * self._sunk[rows])
        sinking = np.where(deep, self._sinking[rows] + 1, 0)
        self._sinking[rows] = np.where(sinking >= PATIENCE, 0, sinking)
        self._sunk[rows] = sunk
        return np.where(sinking >= PATIENCE, 2.0 * penalty, penalty)

    def left(self, sums: Sums, rows: Rows = ...) -> np.ndarray:
        """What is still missing (...), 1 being the most that counts as steady; lowers the rate where that does not come down."""
        left = np.maximum(
            sums.error_largest / AXIAL_ERROR,
            sums.gap_max / self.model.scene.wire.diameter / PENETRATION_LIMIT,
        )
        better = left < 0.9 * self._best[rows]
        waited = np.where(better, 0, self._waited[rows] + 1)
        slower = waited >= RATE_PATIENCE
        self._best[rows] = np.where(better, left, self._best[rows])
        self._waited[rows] = np.where(slower, 0, waited)
        self.rate[rows] = np.where(slower, np.maximum(0.7 * self.rate[rows], RATE_LEAST), self.rate[rows])
        return left

    def mass(self, mass: np.ndarray, axial: np.ndarray, penalty: np.ndarray, sums: Sums) -> np.ndarray:
        """Masses (..., wire) over those of the rest table, raised where `mass` no longer suffices for a step."""
        model = self.model
        h, stiffness = float(model.table.spacing.min()), model.bending_stiffness
        stiffnesses = axial, stiffness, np.asarray(penalty)[..., None], h
        slight, sharp = (unit_step_mass(*stiffnesses, turn, sums.tension_max, self._along) for turn in TURNS)
        slight_at_start, sharp_at_start = self._masses_at_start
        bent = sums.turning_max > TURN_ALLOWANCE  # perhaps where the wire was straight
        needed = np.maximum(slight / slight_at_start, sharp / np.where(bent, slight_at_start, sharp_at_start))
        # the rest table's masses have a margin for a load like that of the start
        return np.where(needed > mass * MASS_HEADROOM, needed * MASS_HEADROOM, mass)
