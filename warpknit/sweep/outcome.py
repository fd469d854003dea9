"""How a state of a sweep ended: the same of the planar and the spatial model."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import Diverged
from ..measure import Observables


@dataclass(frozen=True)
class Outcome:
    """The mesh at rest under a load, or why it is not."""

    index: int  # of the load
    steps: int
    observables: Observables | None
    error: Diverged | None
