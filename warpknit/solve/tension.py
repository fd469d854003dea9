"""The strain at which the mesh carries a prescribed tension, by Broyden's method over equilibria.

Only tension-driven directions are unknowns. The mesh stiffens with strain, so steps are bounded and the diagonal of the
tangent is kept positive. Where the mesh snaps, the tension falls with strain: the states that carry more lie beyond. The tensions
of equilibria scatter by the tolerance of their convergence: a change of tension that is not well above it does not renew the
tangent. Where steps by the same tangent overshoot, they are halved.

A slack mesh becomes taut within a small strain, which the secant through a state on either side does not see: from a slack state
it leads far beyond, from a taut one back to slack. Where a direction is slack and its tension has not changed, its step grows.
After states have changed sides twice, a step ends half way to the last state on the other side at most, unless several such steps
in a row have not changed sides.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

STEP_LIMIT = 0.02  # strain
PROBE = 2e-4  # strain of the first step, which measures the stiffness: before it the order of magnitude is unknown
TOLERANCE = 2e-3  # relative to the target, or to half of the larger tension, by which both scatter; at most
TOLERANCE_SHARE = 2.0 / 3.0  # the same over the residual tolerance, by which tensions scatter
PATIENCE = 20  # equilibria after which the residual tolerance will do, by which tensions scatter
SIGNIFICANT = 2.0  # residual tolerances: relative change of tension that renews the tangent
OVERSHOT = 0.5  # of a step, after one by the same tangent that changed the sign of what is lacking
SLACK = 0.05  # of its target: a direction that carries less is slack
UNCHANGED = 0.1  # of what a direction lacks: a smaller change counts as none
GROWTH = 2.0  # of the step of a slack direction, whose tension has not changed
TRUST = 4.0  # of the last step, unless that was the probe or a direction is slack: the tangent is not known farther away
FAR = 0.1  # of the target: what is lacking where a step is kept from the other side; nearer to it the tangent is good
BRACKETED = 2  # changes of side after which a step stays on this side of the last state on the other one
BRACKETED_STEPS = 4  # in a row, shortened so, after which that state counts no more: the mesh has snapped
MAX_STATES = 60  # equilibria tried for one load level


@dataclass
class TensionSearch:
    """Secant tangent of the search, as plain numbers for a checkpoint."""

    stiffness: list[list[float]] = field(default_factory=list)  # [N/m] change of tension by strain, (2, 2)
    strain: list[float] | None = None  # of the last state
    tension: list[float] | None = None  # [N/m] of the last state
    states: int = 0  # of this level
    miss: list[float] | None = None  # [N/m] tension that the state before lacked
    share: float = 1.0  # of a step by the tangent
    pace: list[float] = field(default_factory=lambda: [1.0, 1.0])  # the same of weft and warp, each by itself
    tried: list[float] | None = None  # strain of the state before
    opposite: list[float] | None = None  # strain of the last state that lacked tension of the other sign
    changes: int = 0  # of the sign, in this level
    shortened: int = 0  # steps since the last change

    def begin_level(self) -> None:
        self.states, self.miss, self.tried, self.share, self.pace = 0, None, None, 1.0, [1.0, 1.0]
        self.opposite, self.changes, self.shortened = None, 0, 0

    def next_strain(
        self,
        strain: np.ndarray,
        tension: np.ndarray,
        target: np.ndarray,
        driven: np.ndarray,
        scale: float,
        residual_tolerance: float,
    ) -> np.ndarray | None:
        """Strain (2,) to try next, or None where the tension is reached.

        strain, tension [N/m], target [N/m] are (weft, warp); `driven` marks the directions driven by tension; `scale`
        [N/m] is EI/C^3, below which tensions count as zero; `residual_tolerance` is that of the equilibria.
        """
        significant = SIGNIFICANT * residual_tolerance * max(float(np.abs(tension).max()), 0.01 * scale)
        is_renewed = self._renew_tangent(strain, tension, driven, significant, 0.02 * scale)
        self.states += 1
        miss = np.where(driven, target - tension, 0.0)
        before = None if self.miss is None else np.array(self.miss)
        overshot = before is not None and miss @ before < 0.0
        if overshot:
            self.opposite, self.changes, self.shortened = self.tried, self.changes + 1, 0
        if before is not None and self.states > 2:  # not after the probe
            slack = driven & (np.abs(tension) < SLACK * target) & (np.abs(miss - before) < UNCHANGED * miss)
            self.pace = np.where(slack, GROWTH * np.array(self.pace), 1.0).tolist()
        self.share = 1.0 if is_renewed else self.share * (OVERSHOT if overshot else 1.0)
        moved = strain - np.array(strain if self.tried is None else self.tried)
        self.miss, self.tried = miss.tolist(), strain.tolist()
        least = max(0.01 * scale, 0.5 * float(np.abs(tension).max()))
        tolerance = min(TOLERANCE, TOLERANCE_SHARE * residual_tolerance)
        if self.states > PATIENCE:
            tolerance = max(TOLERANCE, residual_tolerance)
        if np.all(np.abs(miss) <= tolerance * np.maximum(np.abs(target), least)):
            return None
        if not self.stiffness:
            return strain + PROBE * np.sign(miss)
        step = self.share * np.array(self.pace) * self._step(miss, driven)
        step = np.clip(step, -STEP_LIMIT, STEP_LIMIT)
        last = float(np.abs(moved).max())
        if before is not None and max(self.pace) == 1.0 and (self.states > 2 or last > 2.0 * PROBE):
            step *= min(1.0, TRUST * last / max(float(np.abs(step).max()), 1e-300))
        is_far = float(np.abs(miss).max()) > FAR * float(np.abs(target).max())
        return strain + (self._shortened(strain, step) if is_far else step)

    def _shortened(self, strain: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The step, half way to the last state on the other side at most."""
        if self.opposite is None or self.changes < BRACKETED or self.shortened >= BRACKETED_STEPS:
            return step
        half = 0.5 * (np.array(self.opposite) - strain)
        if step @ half <= half @ half:
            return step
        self.shortened += 1
        return np.asarray(step * (half @ half) / (step @ half))

    def predicted_strain(self, target: np.ndarray, driven: np.ndarray) -> np.ndarray | None:
        """Strain (2,) at which the next target is expected, by the tangent; None before there is one."""
        if not self.stiffness:
            return None
        return np.array(self.strain) + self._step(target - np.array(self.tension), driven)

    def _step(self, miss: np.ndarray, driven: np.ndarray) -> np.ndarray:
        """Strain step (2,) that the tangent gives for a change of tension, at most STEP_LIMIT."""
        k, step, index = np.array(self.stiffness), np.zeros(2), np.nonzero(driven)[0]
        step[index] = np.linalg.lstsq(k[np.ix_(index, index)], miss[index], rcond=None)[0]
        if step @ miss <= 0.0:  # of a stable mesh it is positive, as its tangent is: go on, past the snap
            step[index] = miss[index] / np.diag(k)[index]
        return np.asarray(step * min(1.0, STEP_LIMIT / max(float(np.abs(step).max()), 1e-300)))

    def _renew_tangent(
        self, strain: np.ndarray, tension: np.ndarray, driven: np.ndarray, significant: float, least: float
    ) -> bool:
        """Take a change of tension, if it is `significant` [N/m], into the tangent; its diagonal is at least `least` [N/m].

        Returns whether the tangent is renewed.
        """
        if self.strain is None or self.tension is None:
            self.strain, self.tension = strain.tolist(), tension.tolist()
            return False
        moved, pulled = strain - np.array(self.strain), tension - np.array(self.tension)
        if not moved.any():
            return False
        if not self.stiffness:
            ratio = np.divide(pulled, moved, out=np.zeros(2), where=moved != 0.0)
            k = np.diag(np.where(driven & (ratio > 0.0), ratio, ratio.max()))
        else:
            k = np.array(self.stiffness)
            if max(np.abs(pulled).max(), np.abs(k @ moved).max()) < significant:
                return False
            k = k + np.outer(pulled - k @ moved, moved) / (moved @ moved)
        k[np.diag_indices(2)] = np.maximum(np.diag(k), least)
        self.stiffness, self.strain, self.tension = k.tolist(), strain.tolist(), tension.tolist()
        return True
