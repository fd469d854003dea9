"""Where a run stands, and what it yields: plain numbers for whoever watches it and for a checkpoint, and records of states."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from .tension import TensionSearch


@dataclass(frozen=True)
class Record:
    """A state worth keeping: where it stands in the load and what was observed."""

    index: int
    stage: str
    stage_index: int
    load_factor: float
    temperature: float  # [K]
    steps: int
    steady: bool
    work: float  # [J] put in since the start, where the drive keeps account of it (ramp)
    dissipated: float  # [J] taken out since the start, by the damping of a ramp, by friction or yield
    left_out: float  # of the tension, that the mesh may be out of balance by as a membrane; 0 where that was looked after
    edge_work: float  # [J] put in by what differs from place to place: pulls at the edge, cords, thermal strain
    stations: np.ndarray  # (station, 2) [m] displacement of the rim (rim.py); empty where it only follows the load
    observables: Any  # the state on the host (measure/observables.py)


@dataclass
class LoadStart:
    """The load at the start of a stage; no gradient before it has begun."""

    gradient: list[float] = field(default_factory=list)  # (4,) [-]
    tension: list[float] = field(default_factory=list)  # (weft, warp) [N/m]
    temperature: float = 0.0  # [K]
    levels: float = 0.0  # of the way from there, gone by the smallest mesh of a large one


@dataclass
class Progress:
    """Where a run is: for whoever watches it, and for a checkpoint. Plain numbers."""

    stage_index: int = 0
    stage: str = ""
    level: int = 0  # records of this stage so far
    part: int = 0  # equilibria on the way to the next
    records: int = 0
    steps: int = 0
    solving: bool = False  # inside a level
    load_factor: float = 0.0
    residual: float = 0.0
    checks: int = 0  # convergence checks of the level
    start: LoadStart = field(default_factory=LoadStart)  # of the stage
    search: TensionSearch = field(default_factory=TensionSearch)
    # large meshes
    least_imbalance: float = 1e30  # after any correction of the mesh as a membrane, in the level
    in_vain: int = 0  # corrections since that came down
    trust: float = 1.0  # share of the last correction that was taken; 0 where they are given up
    imbalance: float = 1e30  # of the mesh as a membrane, over what counts as converged
    # ramps
    time: float = 0.0  # [s] of the stage
    work: float = 0.0  # [J]
    compliance: list[float] = field(default_factory=list)  # [m/N] strain by tension, where driven by tension
    strain_move: list[float] = field(default_factory=list)  # at its last check
    followed: list[float] = field(default_factory=list)  # strains and tensions [N/m] at its last check
    stress: list[float] = field(default_factory=list)  # [N/m] nominal stress at the last check

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Progress:
        return cls(**{**values, "search": TensionSearch(**values["search"]), "start": LoadStart(**values["start"])})
