"""The outcome of one load of a sweep."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import Diverged
from ..measure import Observables


@dataclass(frozen=True)
class Outcome:
    """Observables of an equilibrium, or the error."""

    index: int  # of the load
    steps: int
    observables: Observables | None
    error: Diverged | None
