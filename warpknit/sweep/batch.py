"""Many loads of one small mesh, brought to rest side by side: what `warpknit map` runs.

Each replica goes its own way, level by level from the mesh as knitted, as `Relaxation` takes a single mesh: same steps, same
looks, same decisions. It knows nothing of the others, so its answer does not depend on which loads share the batch. The steps
of all are one launch (kernels/replicas.py), and what a look decides is decided for all of them at once. Replicas at rest under
their full load, and those that failed, are left alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
import warp as wp

from ..errors import Diverged
from ..kernels import control as c
from ..planar.diagnostics import Sums, first_blocks, sum_up
from ..planar.model import Model
from ..planar.multiplier_rules import MultiplierRules
from ..planar.step import PROBING
from ..scene import Stage
from ..solve.drive import CHECK_STEPS, Progress
from ..solve.relax import NEARLY_STEADY, SOFTENING_LOOKS, WORSE, Relaxation, drift_looks, patience_of
from .outcome import Outcome
from .replicas import Replicas


class Batch:
    """One stage for each replica; `run` yields them as they come to rest."""

    def __init__(
        self, model: Model, stages: Sequence[Stage], *, watch: Callable[[Batch], None] | None = None, threads: int | None = None
    ) -> None:
        """`stages`: the load of each replica, by strain in both directions. `watch` is called at every look, and may raise to
        stop. `threads` share the work; default: see `Replicas`."""
        self.model = model
        self.stages = tuple(stages)
        self.replicas = Replicas(model, len(self.stages), threads=threads)
        self.members = [Relaxation(model, state, Progress(), _unwatched) for state in self.replicas.states]
        self._watch = watch or (lambda _batch: None)
        count = len(self.stages)
        self._control = self.replicas.state.read_control()
        self._axial = self.replicas.state.wire_axial.numpy()
        self._mass = self.replicas.state.wire_mass.numpy()
        self._rules = MultiplierRules(model, count)
        self._first_block = first_blocks(model.panel)
        self._looks = np.zeros(count, dtype=int)  # of the level
        self._best = np.full(count, np.inf)  # what was left to do at best, in the level
        self._waited = np.zeros(count, dtype=int)  # looks since that came down by a tenth
        self._still = np.zeros(count, dtype=int)  # looks in a row nearly at rest
        self._drift_looks = drift_looks(model.scene.model.nodes_per_loop)
        self._stress = np.zeros((self._drift_looks + 1, count, 2, 2))  # [N/m] at the last of them
        self._partial = [member.look.partial_sums()[:2] for member in self.members]
        self._moved = [member.slowest_mode.partial.numpy() for member in self.members]
        self._stiffer = [member.multipliers.axial.numpy() for member in self.members]
        self._graphs: dict[str, list[wp.Graph]] = {}
        self.steps = 0  # replica-steps taken

    @property
    def done(self) -> float:
        """Share of all load levels that are done."""
        levels = sum(member.progress.level for member in self.members)
        return min(1.0, levels / (len(self.members) * self.model.scene.output.frames))

    def run(self) -> Iterator[Outcome]:
        """Bring every replica to rest under its load."""
        self._capture()
        active = []
        for row, member in enumerate(self.members):
            member.neighbours.search()
            member.progress.stage = self.stages[row].name
            member.progress.start = member.load_now()
            if self._begin_level(row):
                active.append(row)
            else:
                yield self._finished(row)
        while active:
            rows = np.array(active)
            failed = self._advance(rows)
            rows = rows[~np.isin(rows, list(failed))]
            rested = set(self._look(rows, failed).tolist())
            for row, error in failed.items():
                yield Outcome(row, self.members[row].progress.steps, None, error)
            going = []
            for row in rows.tolist():
                if row in rested:
                    self.members[row].progress.settling = False
                    self.members[row].progress.level += 1
                if row in failed:
                    continue
                if row not in rested or self._begin_level(row):
                    going.append(row)
                else:
                    yield self._finished(row)
            active = going
            self._watch(self)

    # --- levels ---

    def _begin_level(self, row: int) -> bool:
        """Put the next load level on; False where the last one was the full load."""
        member, stage, frames = self.members[row], self.stages[row], self.model.scene.output.frames
        progress = member.progress
        if progress.level == 0 and progress.steps == 0 and member.is_at_rest(member.target(stage, 0.0)):
            progress.level = 1
        if progress.level > frames:
            return False
        progress.load_factor = progress.level / frames
        member.begin_level(member.target(stage, progress.load_factor))
        self._rules.begin_level(np.array([row]))
        self._looks[row], self._waited[row], self._still[row], self._best[row] = 0, 0, 0, np.inf
        return True

    def _finished(self, row: int) -> Outcome:
        member = self.members[row]
        record = member.record(self.stages[row], 1.0, steady=True)
        return Outcome(row, member.progress.steps, record.observables, None)

    # --- steps ---

    def _advance(self, rows: np.ndarray) -> dict[int, Diverged]:
        """Take the steps to the next look, searching neighbours where the last search no longer holds; which diverged."""
        step = self._control[:, int(c.STEP)]
        before = step.copy()
        goal = before + CHECK_STEPS
        failed: dict[int, Diverged] = {}
        while len(rows):
            self.replicas.step(rows, goal[rows])
            status = self.replicas.status
            for row in rows[status[rows] == 1.0].tolist():
                self.members[row].neighbours.search()
            for row in rows[status[rows] == 2.0].tolist():
                self.members[row].progress.steps += int(step[row] - before[row])
                failed[row] = self.members[row].divergence()
            rows = rows[(status[rows] != 2.0) & (step[rows] < goal[rows])]
        self.steps += int(np.sum(step - before))
        return failed

    # --- looks ---

    def _look(self, rows: np.ndarray, failed: dict[int, Diverged]) -> np.ndarray:
        """Look at `rows` and decide; those at rest, while those that never will be are added to `failed`."""
        for row in rows.tolist():
            self.members[row].progress.steps += CHECK_STEPS
        self._looks[rows] += 1
        kept = self._control[rows]
        for index, value in PROBING.items():
            self._control[rows, int(index)] = value
        self._replay("look", rows)
        self._control[rows] = kept
        rows = rows[kept[:, int(c.RAMP_STEP)] >= kept[:, int(c.RAMP_STEPS)]]
        if not len(rows):
            return rows
        damping = self._control[rows, int(c.DAMPING)]
        moved = np.stack([self._moved[row].sum(axis=0) for row in rows])
        self._control[rows, int(c.DAMPING)] = self.members[0].slowest_mode.renewed(damping, moved)
        left = self._left(rows)
        near = left < 1.0
        self._still[rows[~near]] = 0
        left[near] = np.maximum(left[near], self._drift(rows[near]))
        going = left >= 1.0
        self._expect_progress(rows[going], left[going], failed)
        if self.model.scene.solver.multipliers and self.model.panel.boundary != "periodic":
            for row in rows[going & (self._looks[rows] % SOFTENING_LOOKS == 0)].tolist():
                self.members[row].multipliers.bound_softening()
        return rows[~going]

    def _left(self, rows: np.ndarray) -> np.ndarray:
        """What is left to do (row,), 1 being the most that counts as steady; moves the multipliers."""
        solver = self.model.scene.solver
        sums = self._sums(rows)
        residual = self.members[0].steadiness.measure(self._control[rows], sums, self._axial[rows])
        for row, value in zip(rows.tolist(), residual.tolist(), strict=True):
            self.members[row].progress.residual = value
        left = residual / solver.residual_tolerance
        if solver.multipliers:
            left = np.maximum(left, self._move_multipliers(rows, sums, left < NEARLY_STEADY))
        return left

    def _sums(self, rows: np.ndarray) -> Sums:
        wires, pairs = (np.stack(part) for part in zip(*(self._partial[row] for row in rows), strict=True))
        held = np.zeros((len(rows), 2, 2))
        if len(self.model.panel.held_node):
            held[:] = [self.members[row].look.held_stress() for row in rows]
        return sum_up(self.model, self._first_block, wires, pairs, held)

    def _move_multipliers(self, rows: np.ndarray, sums: Sums, nearly_steady: np.ndarray) -> np.ndarray:
        """`Multipliers.update` of many."""
        rules = self._rules
        stiffer = rules.outgrown(self._axial[rows].astype(np.float64), sums, nearly_steady, rows)
        penalty = self._control[rows, int(c.CONTACT_STIFFNESS)]
        for row, axial in zip(rows.tolist(), stiffer, strict=True):
            self._stiffer[row][:] = axial
        self._control[rows, int(c.MULTIPLIER_RATE)] = rules.rate[rows]
        self._replay("move", rows)
        stiffened = rules.stiffened(penalty, sums, rows)
        for row, value in zip(rows[stiffened != penalty].tolist(), stiffened[stiffened != penalty].tolist(), strict=True):
            self.members[row].state.stiffen_contact(value)
        self._mass[rows] = rules.mass(self._mass[rows].astype(np.float64), stiffer, stiffened, sums)
        self._axial[rows] = stiffer
        return rules.left(sums, rows)

    def _drift(self, rows: np.ndarray) -> np.ndarray:
        """How much nominal tensions moved over `drift_looks`, over what the tolerance allows; 1 or more before that (row,)."""
        if not len(rows):
            return np.zeros(0)
        self._replay("sums", rows)  # with what the multipliers have just changed
        self._stress[:, rows] = np.roll(self._stress[:, rows], -1, axis=0)
        self._stress[-1, rows] = self._sums(rows).stress
        self._still[rows] += 1
        moved = np.abs(self._stress[-1, rows] - self._stress[0, rows]).max(axis=(1, 2))
        scale = np.maximum(np.abs(self._stress[-1, rows]).max(axis=(1, 2)), self.members[0].least_tension)
        drift = moved / (self.model.scene.solver.residual_tolerance * scale)
        return np.where(self._still[rows] > self._drift_looks, drift, 1.0)

    def _expect_progress(self, rows: np.ndarray, left: np.ndarray, failed: dict[int, Diverged]) -> None:
        better = (left < 0.9 * self._best[rows]) | (left > WORSE * self._best[rows])  # a snap begins anew
        self._best[rows] = np.where(better, left, self._best[rows])
        self._waited[rows] = np.where(better, 0, self._waited[rows] + 1)
        patience = patience_of(self.model.scene.model.nodes_per_loop)
        for row in rows[self._waited[rows] > patience].tolist():
            failed[row] = self.members[row].no_progress()
        for row in rows[self._looks[rows] * CHECK_STEPS > self.members[0].most_steps].tolist():
            failed[row] = self.members[row].too_long()

    # --- launches ---

    def _capture(self) -> None:
        """Record what a look launches at each replica; displacements stand in the first buffers then (CHECK_STEPS is even)."""
        for member in self.members:
            sums = [launch for parts in member.look.launches() for launch in parts]
            probe = [member.slowest_mode.probe.launch, member.slowest_mode.launch_sum]
            for name, launches in (("look", probe + sums), ("sums", sums), ("move", member.multipliers.launches)):
                with wp.ScopedCapture(device=self.model.device) as capture:
                    for launch in launches:
                        launch()
                self._graphs.setdefault(name, []).append(capture.graph)

    def _replay(self, name: str, rows: np.ndarray) -> None:
        """Launch what was captured at each of `rows`."""
        graphs = self._graphs[name]
        parts = [rows[part :: self.replicas.threads].tolist() for part in range(self.replicas.threads)]
        self.replicas.together([partial(_launch_all, [graphs[row] for row in part]) for part in parts if part])


def _launch_all(graphs: Sequence[wp.Graph]) -> None:
    for graph in graphs:
        wp.capture_launch(graph)


def _unwatched(_progress: Progress) -> None:
    """A replica is watched by its batch."""
