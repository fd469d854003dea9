"""The drive `relax`: every load level is brought to equilibrium by dynamic relaxation with fictitious masses.

The load of a level is applied at once or within some steps; the mesh follows the boundary affinely (Cauchy-Born), from an
extrapolation of the last two levels. Strains of directions driven by tension are unknowns (mechanics/driven_strain.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np

from ..base.errors import Diverged, NoProgress, NotCarried, StepLimitExceeded
from ..base.text import engineering, percent
from ..compute.kept import Kept, Owner, strip_prefix
from ..measure import energy_scale
from ..measure.jumps import Level, happens, level_of
from ..measure.strain import stretch
from ..measure.table import Record
from ..mechanics.numerics import FOLLOWED_INCREMENT
from ..mechanics.protocols import Mechanics
from ..mesh.layout import smaller_scene
from ..mesh.rim import LoadPoint
from ..mesh.tight_loops import is_tight
from ..scene import Stage
from .drive import Drive
from .equilibrium import ON_THE_WAY, UNRECORDED, Equilibrium
from .membrane import Lift
from .progress import Progress
from .stage_load import increments_between, strained

DEFAULT_STEP_LIMIT = 500_000  # steps of a level, where the scene gives no max_steps
MAX_CUTS = 4  # how often the increments of a level are halved, before it has failed
MAX_SLOW_CUTS = 2  # the same where it fails after many steps without progress
MOST_KEPT = 300_000  # nodes of a mesh whose last equilibrium is kept to return to: some 2 kB each
FEWEST_LEVELS = 4  # of a stage whose levels are found automatically
MOST_REFINED = 50_000  # nodes of a mesh with stored equilibria: between larger ones no level is added


@dataclass(frozen=True)
class Target:
    """A load level: share of its load step, and its equilibrium once found."""

    share: Fraction
    kept: dict[str, np.ndarray] = field(default_factory=dict)  # to return to
    has_left: bool = False  # the mesh has left an equilibrium there that was not stable
    level: Level | None = None  # of the first rank

    @property
    def numbers(self) -> list[int]:
        """For a checkpoint, beside `arrays`."""
        return [self.share.numerator, self.share.denominator, self.has_left]

    def arrays(self) -> dict[str, np.ndarray]:
        """What is known of its equilibrium."""
        level = {} if self.level is None else vars(self.level)
        return {f"kept_{name}": value for name, value in self.kept.items()} | {
            f"level_{name}": value for name, value in level.items()
        }

    @classmethod
    def restored(cls, numbers: list[int], arrays: dict[str, np.ndarray]) -> Target:
        share, of, has_left = numbers
        level = strip_prefix("level_", arrays)
        return cls(
            Fraction(share, of), strip_prefix("kept_", arrays), bool(has_left), Level.from_arrays(level) if level else None
        )


class Unsolved:
    """Marker between levels of a relaxation: the next step is to find an equilibrium."""


UNSOLVED = Unsolved()


class Relaxation(Drive):
    """Equilibria of the load levels of `output.frames`; the first stage starts with the unloaded state.

    `levels` is a generator that yields wherever an equilibrium has to be found. One mesh (`stage`) and many side by side
    (side_by_side.py) share it.
    """

    rate_key = "output.frames"
    KEPT = (*Drive.KEPT, "_last_gradient", "_before", "lift")

    def __init__(
        self,
        mechanics: Mechanics,
        progress: Progress | None = None,
        monitor: Callable[[Progress], None] = lambda _: None,
        *,
        equilibrium: Equilibrium | None = None,
        row: int = 0,
    ) -> None:
        """`equilibrium`: the solver of many meshes, with this one as number `row`; default: its own."""
        super().__init__(mechanics, progress or Progress(), monitor)
        self._may_cut = self.model.global_model.node_count <= MOST_KEPT
        self.equilibrium = equilibrium or Equilibrium(mechanics.group, [self])
        self.row = row
        rim, is_raised = mechanics.rim, self.scene.panel.focal_length is not None
        self.lift = Lift(mechanics, rim) if rim is not None and (is_raised or rim.is_free) else None
        self._last_gradient: np.ndarray | None = None  # of the previous level
        self._wanted: np.ndarray | None = None  # (2,) [N/m] tension of this level, nan where a strain is given
        self._before: dict[str, np.ndarray] = {}  # the last equilibrium, to return to where an increment fails
        is_small = equilibrium is None and self.model.global_model.node_count <= MOST_REFINED
        self._is_refined = is_small and isinstance(self.scene.output.frames, str)
        self._lower: Target | None = None  # the last recorded level of this stage
        self._targets: list[Target] = []  # the next ones of this stage, the nearest one last

    @property
    def owners(self) -> list[Owner]:
        equilibrium = self.equilibrium
        return [*super().owners, Owner(equilibrium.convergence, self.row, len(equilibrium.relaxations))]

    def state_dict(self, *, copied: bool = True) -> Kept:
        known = [*([] if self._lower is None else [self._lower]), *self._targets]
        kept = {f"target{k}_{name}": value for k, target in enumerate(known) for name, value in target.arrays().items()}
        kept["targets"] = np.array([target.numbers for target in known], dtype=int).reshape(-1, 3)
        return super().state_dict(copied=copied) | kept | {"targets_ahead": np.array(len(self._targets))}

    def equilibrium_dict(self) -> Kept:
        """State and solver variables, to return to within a stage: the progress goes on."""
        return {name: value for name, value in self.state_dict().items() if not name.startswith("target")}

    def load_state_dict(self, kept: Kept) -> None:
        super().load_state_dict(kept)
        if "targets" in kept:
            numbers, ahead = kept["targets"].tolist(), int(kept["targets_ahead"])
            known = [Target.restored(each, strip_prefix(f"target{k}_", kept)) for k, each in enumerate(numbers)]
            self._targets, self._lower = known[len(known) - ahead :], known[0] if len(known) > ahead else None

    # --- levels

    def stage(self, stage: Stage) -> Iterator[Record]:
        levels = self.levels(stage)
        step = next(levels, None)
        while step is not None:
            if isinstance(step, Unsolved):
                try:
                    self.equilibrium.solve()
                except Diverged as error:
                    step = levels.throw(error)
                    continue
            else:
                yield step
            del step  # the fields of a record are as large as the state
            step = next(levels, None)

    def all_levels(self, *, ends_only: bool) -> Generator[Record | Unsolved, None, None]:
        """The `levels` of all stages from `progress` on."""
        for stage in self.stages():
            yield from self.levels(stage, ends_only=ends_only)

    def levels(self, stage: Stage, *, ends_only: bool = False) -> Generator[Record | Unsolved, None, None]:
        """Records of the load levels of a stage, each in equilibrium; UNSOLVED before each equilibrium to find.

        Where that fails, `Diverged` is thrown in: the increment is halved from the last equilibrium on, MAX_CUTS times at most.
        Where levels are refined, the mesh returns to the lower one of two with an event between them (measure/jumps.py) and is
        loaded half-way; the upper one is kept, and recorded after all levels before it. ends_only: the record of the last level.
        """
        targets, tolerance = self._targets, self.scene.output.load_tolerance
        if not targets:
            self._plan_levels(stage)
        while targets:
            lower, upper, is_here = self._lower, targets[-1], False
            width = upper.share - (upper.share if lower is None else lower.share)
            is_wide, is_recorded = self._is_refined and width > tolerance, upper.share == 1 or not ends_only
            if not upper.kept:
                try:
                    yield from self._increment(stage, upper.share, width, may_cut=not is_wide, is_recorded=is_recorded)
                except Diverged as error:
                    if lower is None or not is_wide or error.is_final:
                        raise
                    self._return_to(lower)
                    targets.append(Target(upper.share - width / 2))
                    continue
                upper, is_here = self._reached(upper.share), True
                targets[-1] = upper
            if lower is not None and is_wide and self._has_event(lower, upper):
                self._return_to(lower)
                targets.append(Target(upper.share - width / 2))
                continue
            if not is_here:
                self._return_to(upper)
            self._lower = targets.pop()
            if upper.has_left:  # what was found beyond may be of another branch
                targets[:] = [Target(target.share) for target in targets]
            self.progress.level += 1
            if is_recorded:
                yield self.record(stage, float(upper.share), steady=True)

    def _plan_levels(self, stage: Stage) -> None:
        """Begin with equal levels."""
        count = self._fewest_levels(stage) if self._is_refined else self.scene.output.levels
        self._targets += [Target(Fraction(k, count)) for k in range(count, 0, -1)]
        unloaded = self.progress.stage_index == 0
        self._lower = None if unloaded else self._reached(Fraction(0))
        if unloaded and self._is_refined and any(stage.by_tension):  # little tension ends slack, once
            self._targets.append(Target(Fraction(1, math.ceil(1.0 / self.scene.output.load_tolerance))))
        if unloaded:
            self._targets.append(Target(Fraction(0)))

    def _fewest_levels(self, stage: Stage) -> int:
        """Number of levels of a stage without events; small enough increments for a tight knit."""
        follows = self.scene.depends_on_path or self.model.cloth is None or smaller_scene(self.scene) is not None
        if follows or not self.scene.model.of_kind.has_branches or not is_tight(self.scene):
            return FEWEST_LEVELS
        strain = float(np.abs(self.target(stage, 1.0).gradient - self.state.gradient).max())
        return max(FEWEST_LEVELS, math.ceil(strain / FOLLOWED_INCREMENT - 1e-6))

    def _reached(self, share: Fraction) -> Target:
        """The present equilibrium as a level; it is kept where levels are refined."""
        if not self._is_refined:
            return Target(share)
        dissipated, observed, level = self.dissipated if self.edge_work is None else math.nan, self.mechanics.observe(), None
        if self.model.ranks.is_first:
            level = level_of(observed, float(share), dissipated)
        return Target(share, self.equilibrium_dict(), self.mechanics.has_left, level)

    def _has_event(self, lower: Target, upper: Target) -> bool:
        """Whether an event lies between two levels."""
        scale = energy_scale(self.model.global_model)

        def is_found() -> bool:
            return lower.level is not None and upper.level is not None and happens(lower.level, upper.level, scale)

        return upper.has_left or bool(self.model.ranks.from_first(is_found))

    def _return_to(self, target: Target) -> None:
        """Return to the equilibrium of a level; its notes come on top."""
        progress, notes = self.progress, list(self.mechanics.notes)
        self._go_back(target.kept)
        progress.part, progress.whole, progress.cuts, progress.is_kept = 0, 0, 0, False
        progress.load_factor = float(target.share)
        self.mechanics.notes += [note for note in notes if note not in self.mechanics.notes]

    def _go_back(self, equilibrium: Kept) -> None:
        """Return to an equilibrium; the level on the way ends unsolved."""
        before, recorded = self._before, copy(self.edge_work)  # from record to record
        self.load_state_dict(equilibrium)
        self._before, self.edge_work = before, recorded
        self.progress.solving, self.progress.level_share = False, 0.0

    def _increment(
        self, stage: Stage, share: Fraction, width: Fraction, *, may_cut: bool, is_recorded: bool
    ) -> Iterator[Unsolved]:
        """Go to a share of the load of a stage, from `width` before it.

        may_cut: halve the increment where it fails, else raise `Diverged`. is_recorded: whether a record follows.
        """
        progress, factor = self.progress, float(share)
        unloaded = progress.stage_index == 0
        driven = np.array(stage.by_tension)
        tension_start = np.zeros(2) if unloaded else np.array(progress.start.tension)  # as knitted it is scatter about zero
        tension_end = np.array([stage.tension_weft or 0.0, stage.tension_warp or 0.0])
        while True:
            if not progress.solving:  # more parts, where the mesh no longer starts from a smaller one
                whole = self._parts_of_level(stage, factor, float(width))
                progress.part, progress.whole = progress.part * whole // (progress.whole or whole), whole
            if progress.part == (parts := progress.whole << progress.cuts):
                break
            self._keep(may_cut=may_cut and (factor > 0.0 or progress.whole > 1))
            there = max(0.0, factor - float(width * Fraction(parts - progress.part - 1, parts)))
            progress.load_factor = there
            if factor == 0.0:
                self.release(progress.part / parts, (progress.part + 1) / parts)
            load = self.target(stage, there)
            if driven.any() and there > 0.0:
                load = replace(load, tension=np.where(driven, tension_start + there * (tension_end - tension_start), np.nan))
            try:
                to_ratio = 1.0
                if load.tension is None and self.scene.depends_on_path:
                    to_ratio = ON_THE_WAY if progress.part + 1 < parts else 1.0
                elif load.tension is None and not is_recorded:
                    to_ratio = UNRECORDED
                yield from self.reach(load, to_ratio)
            except Diverged as error:
                self._cut(error)
                continue
            self.mechanics.advance_history()
            progress.part, progress.is_kept = progress.part + 1, False
        if progress.cuts:
            self.mechanics.notes.append(f"{self._level_text()} was reached in {parts} increments, because larger ones failed")
        progress.part, progress.whole, progress.cuts, self._before = 0, 0, 0, {}

    def _keep(self, *, may_cut: bool) -> None:
        """Keep the present equilibrium, unless the mesh is large; a resumed level keeps its first one."""
        if self.progress.is_kept:
            return
        self.progress.is_kept, self._before = True, {}
        if may_cut and self._may_cut:
            self._before = self.equilibrium_dict()

    def _cut(self, error: Diverged) -> None:
        """Return to the last equilibrium and halve the increments; raises the error after too many cuts."""
        progress = self.progress
        is_slow = isinstance(error, NoProgress) and progress.cuts >= MAX_SLOW_CUTS
        if not self._before or progress.cuts == MAX_CUTS or is_slow or error.is_final:
            raise error
        self._go_back(self._before)
        progress.cuts, progress.part = progress.cuts + 1, 2 * progress.part

    def _parts_of_level(self, stage: Stage, factor: float, width: float) -> int:
        """Number of increments to a level; unloaded: of its natural curvature."""
        if factor <= 0.0:
            return self.mechanics.release_parts
        begin, end = self.target(stage, factor - width), self.target(stage, factor)
        return increments_between(begin, end, self.rim, self.scene.history_increment)

    def release(self, begin: float, end: float) -> None:
        """Apply `wire.set_fraction` from one share of it to another."""
        self.mechanics.release(begin, end)

    def reach(self, load: LoadPoint, to_ratio: float = 1.0) -> Iterator[Unsolved]:
        """Find the equilibrium at a load, or continue an unfinished one. to_ratio: see `Convergence.with_drift`."""
        progress, self._wanted = self.progress, load.tension
        as_knitted = progress.stage_index == 0 and progress.level == 0 and progress.load_factor == 0.0
        if progress.steps == 0 and self.mechanics.is_in_equilibrium(load):
            return
        self.mechanics.may_overlap = as_knitted and progress.part == 0
        self.mechanics.rub(not as_knitted)
        if not progress.solving:
            load = self._prepare(load)
            self.begin_level(load, to_ratio)
        yield UNSOLVED
        while load.tension is not None and self.mechanics.group.strains.at_limit(self.mechanics.rows).any():
            self.mechanics.advance_history()
            self.begin_level(replace(load, gradient=self.state.gradient), to_ratio)
            yield UNSOLVED
        self.mechanics.may_overlap = False
        progress.solving, progress.level_share = False, 0.0

    def solve(self, load: LoadPoint, to_ratio: float = 1.0) -> None:
        """Find the equilibrium under a load; to_ratio: see `Convergence.with_drift`. Raises `Diverged`."""
        for _ in self.reach(load, to_ratio):
            self.equilibrium.solve()

    def keep_history(self) -> None:
        """Keep the present equilibrium as load history, with friction or yield."""
        if self.scene.depends_on_path:
            self.mechanics.advance_history()

    def equilibrium_at(self, gradient: np.ndarray, temperature: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Stress and state of the equilibrium under a load; see `stress_and_state`."""
        self.solve(LoadPoint(gradient, temperature))
        return self.stress_and_state()

    def stress_and_state(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Nominal stress (2, 2) [N/m] of the present equilibrium, and its state variables."""
        return self.mechanics.observe().nominal_stress, self.mechanics.state_variables()

    def equilibrium_beside(self, gradient: np.ndarray, temperature: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The same, from the present equilibrium, to which the mesh then returns; without checkpoints on the way."""
        kept, monitor = self.equilibrium_dict(), self.monitor
        self.monitor = lambda _: None
        try:
            found = self.equilibrium_at(gradient, temperature)
        finally:
            self.monitor = monitor
        self._go_back(kept)
        return found

    def _prepare(self, load: LoadPoint) -> LoadPoint:
        """Prepare a load level; return its load.

        Where tension is given, the load begins at the present strains, plus the expansion of the wires."""
        return strained(load, self._expansion(load) * load.gradient)

    def _expansion(self, load: LoadPoint) -> float:
        """Length of the wires at the temperature of a load over their present length."""
        return self.scene.wire.length_factor(load.temperature) / float(self.state.steering.length_factor)

    def begin_level(self, load: LoadPoint, to_ratio: float) -> None:
        """Start the next level: predict its state and apply its load; see `Convergence.with_drift`."""
        self._apply(load)
        self.mechanics.begin_level()
        if to_ratio <= UNRECORDED:  # test whether the equilibrium is stable, surely before the load and at the end of a stage
            self.mechanics.begin_test(is_certain=not 0.0 < self.progress.load_factor < 1.0)
        self.progress.solving = True
        self._begin_solving(to_ratio)

    def _apply(self, load: LoadPoint) -> None:
        """Extrapolate the state from the last two levels, and apply the load."""
        now = self.state.gradient.ravel()
        ratio = 0.0
        if self._last_gradient is not None and not self.scene.depends_on_path:
            before = now - self._last_gradient
            driven = np.zeros(2, dtype=bool) if load.tension is None else np.isfinite(load.tension)
            ahead = (load.gradient / np.where(driven, self._expansion(load), 1.0)).ravel() - now
            ratio = float(np.clip(ahead @ before / max(before @ before, 1e-30), 0.0, 1.0))
        self.mechanics.predict(ratio)
        self._last_gradient = now
        self.mechanics.set_load(load, self.mechanics.load_steps(load, predicted=ratio > 0.0))

    def compile(self) -> None:
        super().compile()
        if self.lift is not None:
            kept = self.snapshot()
            self.lift.warm_up()
            self.restore(kept)

    def _begin_solving(self, to_ratio: float) -> None:
        self.equilibrium.begin(self.row, to_ratio)
        if self.lift is not None:
            self.lift.begin()

    def corrected(self, ratio: float) -> tuple[float, bool]:
        """The residual ratio after further corrections, and whether they have moved the mesh."""
        if self.lift is None or math.isinf(ratio):
            return ratio, False
        moved = self.lift.correct(self.progress.checks, self.progress.residual)
        return max(ratio, self.lift.imbalance), moved

    # --- failures

    @property
    def step_limit(self) -> int:
        """Largest number of steps of a level."""
        return self.scene.solver.max_steps or DEFAULT_STEP_LIMIT

    def stalled(self) -> Diverged:
        """The error of a level that makes no progress."""
        steps = self.equilibrium.convergence.patience * self.mechanics.check_steps
        return NoProgress(self._unconverged(f": no progress in {steps:,} steps; try"))

    def exceeded_steps(self) -> Diverged:
        """The error of a level that exceeds its step limit."""
        return StepLimitExceeded(self._unconverged(f" in {self.step_limit:,} steps; raise solver.max_steps, or try"))

    def _unconverged(self, how: str) -> str:
        """Unmet criteria of a level, and advice."""
        (wire, node), tolerance = self.mechanics.fastest(), self.scene.solver.residual_tolerance
        advice, unmet = " or solver.residual_tolerance", ""
        if self.progress.residual < tolerance and not self.equilibrium.convergence.drifts(self.row):
            advice, unmet = "", " multipliers or membrane corrections not converged,"
        wires, prestress = self.scene.wires, ""
        if wires is not None and wires.overlaps == "prestress" and self.mechanics.notes and self.progress.load_factor == 0.0:
            prestress = "; wires.overlaps = 'at rest' avoids prestress"
        return (
            f"{self._level_text()} did not converge{how} a larger model.nodes_per_loop{advice}, or other output.frames"
            f"{prestress} (residual {self.progress.residual:.2g}, tolerance {tolerance:g},{unmet} fastest at"
            f" wire {wire}, node {node}{self._causes()})"
        )

    def not_carried(self) -> Diverged:
        """The error of a mesh that strains without end under its tensions."""
        largest = [engineering(float(tension), "N/m") for tension in self.mechanics.group.strains.largest[self.row]]
        strain = [percent(strain, 0) for strain in np.diag(stretch(self.state.gradient)) - 1.0]
        return NotCarried(
            f"{self._level_text()}: the mesh does not carry this tension (weft strain {strain[0]}, warp strain {strain[1]}); load"
            f" by strains, or up to the largest converged tension: {largest[0]} in weft, {largest[1]} in warp"
        )

    def _level_text(self) -> str:
        """The level and its load: the wanted tension, or the strain, in weft and warp."""
        load = [percent(strain) for strain in np.diag(stretch(self.state.gradient)) - 1.0]
        if self._wanted is not None:
            for side in np.flatnonzero(np.isfinite(self._wanted)):
                load[side] = engineering(float(self._wanted[side]), "N/m")
        return f"load level {self.progress.load_factor:.3g} of load step {self.progress.stage!r} (weft {load[0]}, warp {load[1]})"
