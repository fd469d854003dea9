"""Progress of a run, as plain numbers for displays and checkpoints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

MOST_SHARE = 0.9  # largest reported share of convergence of an unconverged level
UNKNOWN = 1e30  # a ratio that is not known yet


@dataclass
class LoadStart:
    """The load at the start of a stage; the gradient is empty before it begins."""

    gradient: list[float] = field(default_factory=list)  # (4,) [-]
    tension: list[float] = field(default_factory=list)  # (weft, warp) [N/m]
    temperature: float = 0.0  # [K]
    levels: float = 0.0  # increments from there that the smallest mesh has solved


@dataclass
class Progress:
    """Progress of a run, as plain numbers."""

    stage_index: int = 0
    stage: str = ""
    level: int = 0  # records of this stage so far
    part: int = 0  # increments solved of the next level
    whole: int = 0  # all increments of that level, before they were halved; 0 where it has not begun
    is_kept: bool = False  # the equilibrium before the next increment is kept
    cuts: int = 0  # how often the increments of that level were halved
    records: int = 0
    steps: int = 0
    solving: bool = False  # inside a level
    load_factor: float = 0.0
    residual: float = 0.0
    checks: int = 0  # convergence checks of the level
    largest_ratio: float = 0.0  # of the level: the unmet criteria of convergence, over their tolerances
    to_ratio: float = 1.0  # criteria of convergence over their tolerances that are asked for
    level_share: float = 0.0  # of the way to convergence, in decades of that ratio; 0 while smaller meshes are solved
    start: LoadStart = field(default_factory=LoadStart)  # of the stage
    # large meshes
    ratio: float = UNKNOWN  # residual over its tolerance at the last check
    next_balance: int = 0  # check from which the balance as a membrane is due
    next_correction: int = 0  # check from which the mesh may be moved as a membrane again
    is_prolonged: bool = True  # the level starts from the smaller mesh
    is_uncorrected: bool = False  # the mesh is not moved as a membrane in this level
    imbalance: float = UNKNOWN  # out-of-balance membrane stress over its tolerance
    # ramps
    time: float = 0.0  # [s] of the stage
    work: float = 0.0  # [J]
    compliance: list[float] = field(default_factory=list)  # [m/N] strain by tension, where driven by tension
    strain_move: list[float] = field(default_factory=list)  # strain increments at the last check
    followed: list[float] = field(default_factory=list)  # strains and tensions [N/m] at the last check
    stress: list[float] = field(default_factory=list)  # [N/m] nominal stress at the last check

    def begin_level(self, to_ratio: float = 1.0) -> None:
        """A level begins: it has no check yet."""
        self.checks, self.largest_ratio, self.level_share = 0, 0.0, 0.0
        self.to_ratio = to_ratio

    def approach(self, ratio: float) -> None:
        """Note, at a check, the unmet criteria of convergence over their tolerances."""
        if not 1.0 < ratio < UNKNOWN:
            return
        self.largest_ratio = max(self.largest_ratio, ratio)
        share = 1.0 - math.log(ratio) / math.log(self.largest_ratio)
        self.level_share = max(self.level_share, min(share, MOST_SHARE))

    def as_dict(self) -> dict[str, object]:
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Progress:
        return cls(**{**values, "start": LoadStart(**values["start"])})
