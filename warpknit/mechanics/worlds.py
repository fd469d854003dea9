"""Worlds: meshes of one topology, stepped and checked side by side; one mesh is a group too. `rows` are indices of some of them.

What either model does in its own way is abstract: steps, searches, convergence checks, stresses.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from ..compute.steering import Steering
from ..mesh.rim import LoadPoint
from .driven_strain import DrivenStrain
from .protocols import Check


class Worlds(ABC):
    """Results of a world do not depend on the others."""

    members: Sequence[Any]  # `Mechanics` of each world, as far as the model has it

    def __init__(self, models: Sequence[Any], steering: Steering, rigidity: float) -> None:
        """models: of each world; steering: a row a world; rigidity [N m]: sum of EA times length over the wires of a mesh."""
        self.model: Any = models[0]
        self.steering = steering
        self.strains = DrivenStrain(self, len(models), rigidity)
        self.touches = np.ones(len(models), dtype=bool)  # at the last check: elastic wires that do not have no history
        self._waiting: dict[int, LoadPoint] | None = None  # worlds whose loads begin together

    # --- loads

    @contextmanager
    def together(self) -> Iterator[None]:
        """Start the loads set inside at the end: in all worlds at once."""
        self._waiting = {}
        try:
            yield
            waiting = dict(sorted(self._waiting.items()))
        finally:
            self._waiting = None
        if waiting:
            self._begin_loads(waiting)

    def begin_load(self, world: int, load: LoadPoint) -> None:
        """Begin the load of a world, now or with others."""
        if self._waiting is None:
            self._begin_loads({world: load})
        else:
            self._waiting[world] = load

    def _begin_loads(self, loads: dict[int, LoadPoint]) -> None:
        rows, given = np.array(list(loads)), np.full(2, np.nan)
        self.strains.begin(rows, np.array([given if load.tension is None else load.tension for load in loads.values()]))
        self.prepare(rows)

    def prepare(self, rows: np.ndarray) -> None:
        """Prepare worlds for the motion of their loads."""
        return

    def is_loading(self, rows: np.ndarray) -> np.ndarray:
        """[row] whether a load is being applied."""
        return np.asarray(self.steering.is_loading[rows]) | self.strains.is_fast(rows)

    # --- steps

    @abstractmethod
    def count_stress(self) -> None:
        """Let steps sum their nominal stress, for strains driven by tension."""

    @abstractmethod
    def step(self, rows: np.ndarray, last_step: np.ndarray) -> None:
        """Step worlds until each has taken `last_step` [row] steps, or is frozen."""

    def let_rest(self) -> None:
        """Let steps leave out nodes at rest: membrane corrections move long waves."""
        return

    def move_all(self, rows: np.ndarray) -> None:
        """Let nodes at rest move again, up to the next load."""
        return

    @abstractmethod
    def search(self, rows: np.ndarray) -> None:
        """Search neighbours, and reset the travel budget."""

    def overlap(self, rows: np.ndarray) -> np.ndarray:
        """[row] largest overlap of wires since the last call, over their thickness; none in a plane."""
        return np.zeros(len(rows))

    def advance(self, rows: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Take steps with neighbour searches; return steps taken [row] and whether diverged [row]."""
        if self.strains.driven(rows).any():
            self.count_stress()
        begin = now = self.steering.step
        diverged, active = np.zeros(len(begin), dtype=bool), rows
        while len(active):
            self.step(active, begin[active] + steps)
            read = self.steering.read()
            now, status = read.step, read.status
            stale = active[status[active] == Steering.STALE]
            if len(stale):
                self.search(stale)
            diverged[active] = status[active] == Steering.DIVERGED
            active = active[~diverged[active] & (now[active] < begin[active] + steps)]
        return (now - begin)[rows].astype(int), diverged[rows]

    # --- convergence

    @abstractmethod
    def check(self, rows: np.ndarray, checks: np.ndarray, loading: np.ndarray) -> Check:
        """Check convergence, and update damping, multipliers and masses; checks [row]: of the level so far, this one included."""

    @abstractmethod
    def stress(self, rows: np.ndarray) -> np.ndarray:
        """(row, 2, 2) [N/m] nominal stress of the meshes."""

    @abstractmethod
    def stress_at(self, rows: np.ndarray) -> np.ndarray:
        """The same (row, 2, 2) [N/m] under the present strains, which are close to the last evaluation."""

    @abstractmethod
    def stress_now(self, rows: np.ndarray) -> np.ndarray:
        """(row, 2, 2) [N/m] the same in the state last evaluated."""

    def converged_stress(self, rows: np.ndarray) -> np.ndarray:
        """A stress (row, 2, 2) [N/m] that is constant only where the strains are, too."""
        stress = self.stress(rows).copy()
        stress[:, [0, 1], [0, 1]] -= self.strains.carried[rows]
        return stress
