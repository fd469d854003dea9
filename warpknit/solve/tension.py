"""The strain at which the mesh carries a prescribed tension, by a tangent from equilibria.

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

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

PROBE = 2e-4  # strain of the first step, which measures the stiffness: before it the order of magnitude is unknown
TOLERANCE = 2e-3  # relative to the target, or to half of the larger tension, by which both scatter; at most
TOLERANCE_SHARE = 1.0 / 3.0  # the same over the residual tolerance: soft meshes answer heat by few tolerances of their strain
PATIENCE = 20  # equilibria after which the residual tolerance will do, by which tensions scatter
LAST_PATIENCE = 60  # after which TOLERANCE will do where that is smaller
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
STEP_LIMIT = 0.02  # strain


def relative_miss(tension: np.ndarray, target: np.ndarray, driven: np.ndarray, scale: float) -> float:
    """Largest of what the `driven` directions lack, over the target, or over half of the larger tension where that is more.

    tension, target [N/m] and scale [N/m] as in `TensionSearch.next_strain`.
    """
    least = max(0.01 * scale, 0.5 * float(np.abs(tension).max()))
    return float(np.max(np.abs(target - tension) / np.maximum(np.abs(target), least), where=driven, initial=0.0))


@dataclass
class SecantTangent:
    """Secant tangent of the tensions in weft and warp by the strains: Broyden's method, as plain numbers for a checkpoint."""

    stiffness: list[list[float]] = field(default_factory=list)  # [N/m] change of tension by strain, (2, 2)
    strain: list[float] | None = None  # of the last state
    tension: list[float] | None = None  # [N/m] of the last state

    def predicted_strain(self, target: np.ndarray, driven: np.ndarray) -> np.ndarray | None:
        """Strain (2,) at which the tension `target` [N/m] is expected; None before there is a tangent."""
        if not self.stiffness:
            return None
        return np.array(self.strain) + self.step(target - np.array(self.tension), driven)

    def step(self, miss: np.ndarray, driven: np.ndarray) -> np.ndarray:
        """Strain step (2,) of the `driven` directions for a change of tension `miss` [N/m], at most STEP_LIMIT."""
        k, step, index = np.array(self.stiffness), np.zeros(2), np.nonzero(driven)[0]
        step[index] = np.linalg.lstsq(k[np.ix_(index, index)], miss[index], rcond=None)[0]
        if step @ miss <= 0.0:  # of a stable mesh it is positive, as its tangent is: go on, past the snap
            step[index] = miss[index] / np.diag(k)[index]
        return np.asarray(step * min(1.0, STEP_LIMIT / max(float(np.abs(step).max()), 1e-300)))

    def renew(self, strain: np.ndarray, tension: np.ndarray, driven: np.ndarray, significant: float, least: float) -> bool:
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


@dataclass
class LevelSearch:
    """The equilibria of one load level: what they lacked, and how long the next step may be."""

    states: int = 0
    is_exact: bool = False  # whether an exact equilibrium was asked for
    miss: list[float] | None = None  # [N/m] tension that the last state lacked
    tried: list[float] | None = None  # its strain
    share: float = 1.0  # of a step by the tangent
    pace: list[float] = field(default_factory=lambda: [1.0, 1.0])  # the same of weft and warp, each by itself
    last: float = 0.0  # larger strain of the last step
    opposite: list[float] | None = None  # strain of the last state that lacked tension of the other sign
    changes: int = 0  # of the sign
    shortened: int = 0  # steps since the last change

    def add(
        self, strain: np.ndarray, tension: np.ndarray, target: np.ndarray, driven: np.ndarray, *, is_renewed: bool
    ) -> np.ndarray:
        """A further equilibrium; returns what it lacks (2,) [N/m]. `is_renewed`: the tangent knows it."""
        self.states += 1
        miss = np.where(driven, target - tension, 0.0)
        overshot = False
        if self.miss is not None and self.tried is not None:
            before = np.array(self.miss)
            overshot = bool(miss @ before < 0.0)
            self.last = float(np.abs(strain - np.array(self.tried)).max())
            if overshot:
                self.opposite, self.changes, self.shortened = self.tried, self.changes + 1, 0
            if self.states > 2:  # not after the probe
                slack = driven & (np.abs(tension) < SLACK * target) & (np.abs(miss - before) < UNCHANGED * miss)
                self.pace = np.where(slack, GROWTH * np.array(self.pace), 1.0).tolist()
        self.share = 1.0 if is_renewed else self.share * (OVERSHOT if overshot else 1.0)
        self.miss, self.tried = miss.tolist(), strain.tolist()
        return miss

    def limited(self, step: np.ndarray, *, is_far: bool) -> np.ndarray:
        """The step (2,) of the tangent, no longer than the equilibria so far allow; `is_far` from the target."""
        step = np.clip(self.share * np.array(self.pace) * step, -STEP_LIMIT, STEP_LIMIT)
        if max(self.pace) == 1.0 and self.last > (0.0 if self.states > 2 else 2.0 * PROBE):
            step *= min(1.0, TRUST * self.last / max(float(np.abs(step).max()), 1e-300))
        if not is_far or self.opposite is None or self.changes < BRACKETED or self.shortened >= BRACKETED_STEPS:
            return step
        half = 0.5 * (np.array(self.opposite) - np.array(self.tried))
        if step @ half <= half @ half:
            return step
        self.shortened += 1
        return np.asarray(step * (half @ half) / (step @ half))


@dataclass
class TensionSearch:
    """Search of one load level after the other, as plain numbers for a checkpoint."""

    tangent: SecantTangent = field(default_factory=SecantTangent)
    level: LevelSearch = field(default_factory=LevelSearch)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> TensionSearch:
        return cls(SecantTangent(**values["tangent"]), LevelSearch(**values["level"]))

    def begin_level(self) -> None:
        self.level = LevelSearch()

    def next_strain(
        self,
        strain: np.ndarray,
        tension: np.ndarray,
        target: np.ndarray,
        driven: np.ndarray,
        scale: float,
        residual_tolerance: float,
        to_ratio: float = 1.0,
    ) -> np.ndarray | None:
        """Strain (2,) to try next, or None where the tension is reached.

        strain, tension [N/m], target [N/m] are (weft, warp); `driven` marks the directions driven by tension; `scale`
        [N/m] is EI/C^3, below which tensions count as zero; `residual_tolerance` is that of exact equilibria, to which `to_ratio`
        times this one has converged.
        """
        significant = SIGNIFICANT * to_ratio * residual_tolerance * max(float(np.abs(tension).max()), 0.01 * scale)
        is_renewed = self.tangent.renew(strain, tension, driven, significant, 0.02 * scale)
        miss = self.level.add(strain, tension, target, driven, is_renewed=is_renewed)
        tolerance = min(TOLERANCE, TOLERANCE_SHARE * residual_tolerance)
        if self.level.states > PATIENCE:
            tolerance = residual_tolerance
        if self.level.states > LAST_PATIENCE:
            tolerance = max(TOLERANCE, residual_tolerance)
        if relative_miss(tension, target, driven, scale) <= tolerance:
            return None
        if not self.tangent.stiffness:
            return strain + PROBE * np.sign(miss)
        is_far = float(np.abs(miss).max()) > FAR * float(np.abs(target).max())
        return strain + self.level.limited(self.tangent.step(miss, driven), is_far=is_far)
