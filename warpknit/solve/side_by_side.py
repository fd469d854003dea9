"""Relaxations of many worlds side by side: each goes through its own levels, and those that are done or have failed wait."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from typing import Any

import numpy as np

from ..base.errors import Diverged
from ..mechanics.protocols import Model
from .equilibrium import Equilibrium
from .model import worlds_of
from .progress import Progress
from .relax import Relaxation, Unsolved

# what a world goes through: what it finds, and UNSOLVED wherever it is to be brought to equilibrium; `Diverged` is thrown in
Findings = Generator[Any, None, None]


class SideBySide:
    """Worlds of one topology, each with a relaxation (`members`)."""

    def __init__(
        self, models: Sequence[Model], findings_of: Callable[[Relaxation], Findings], progress: Sequence[Progress] = ()
    ) -> None:
        """models: of each world; findings_of: what a relaxation goes through; progress: of each, where they go on."""
        self.group = worlds_of(models)
        self.members: list[Relaxation] = []
        self.equilibrium = Equilibrium(self.group, self.members)
        for row, mechanics in enumerate(self.group.members):
            begun = progress[row] if progress else None
            self.members.append(Relaxation(mechanics, begun, equilibrium=self.equilibrium, row=row))
        self.resumed = bool(progress)
        self._findings = [findings_of(member) for member in self.members]

    def run(self, monitor: Callable[[], None] = lambda: None, without: Collection[int] = ()) -> Iterator[tuple[int, Any]]:
        """Number of a world and its finding, or its final `Diverged`; in order of arrival.

        monitor: called at every convergence check; may raise to stop. without: worlds that have ended before.
        """
        rows = np.setdiff1d(np.arange(len(self.members)), list(without))
        if not self.resumed:
            self.group.search(rows)
        due: dict[int, Diverged | None] = dict.fromkeys(rows.tolist())  # worlds that go on, after an error or none
        active: list[int] = []
        while due or active:
            found: list[tuple[int, Any]] = []
            with self.group.together():
                active += [row for row, error in due.items() if self._goes_on(row, error, found)]
            yield from found
            if not active:
                return
            monitor()
            check = self.equilibrium.advance(np.array(sorted(active)))
            due = {row: check.failed.get(row) for row in [*check.failed, *check.converged]}
            active = [row for row in active if row not in due]

    def _goes_on(self, row: int, error: Diverged | None, found: list[tuple[int, Any]]) -> bool:
        """Go to the next equilibrium of a world, or end; adds to what is `found` on the way."""
        findings = self._findings[row]
        try:
            step = next(findings, None) if error is None else findings.throw(error)
            while step is not None and not isinstance(step, Unsolved):
                found.append((row, step))
                step = next(findings, None)
        except Diverged as failure:  # also where no strain carries the tension
            found.append((row, failure))
            return False
        return step is not None
