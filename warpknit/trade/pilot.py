"""A small mesh of the same knit, wire and load, run at few and at many nodes: what an error costs, before and after a run.

Errors of node spacing are alike in every repeat, and at a grip alike at every grip. So a periodic tile is judged by one repeat,
and a gripped mesh by PATCH repeats a side, whose grips weigh so many times more. Where repeats differ, or the state depends on
the path or on what is done to the edge, the mesh itself is taken as it is, without what moves its edge.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import cached_property

from ..errors import Diverged
from ..model import build_model, trials_of
from ..scene import PanelOptions, Scene
from ..trial import Setting, edge_of
from .point import Errors, Found, Outcome, Scales, errors_of, run_point, scales_of

PATCH = 2  # repeats a side of the gripped pilot
LEVELS = 2  # of a pilot whose state does not depend on the path
SAFETY = 1.3  # what an estimate is multiplied by
FLOOR_PERCENT = 0.2  # added to it: the error of the fine run, and what the tolerance leaves


def with_setting(scene: Scene, setting: Setting) -> Scene:
    """The scene with other numerics."""
    model = replace(scene.model, nodes_per_loop=setting.nodes_per_loop)
    numerics = asdict(setting)
    del numerics["nodes_per_loop"]
    return replace(scene, model=model, solver=replace(scene.solver, **numerics))


class Pilot:
    """The small mesh of a scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.edge = edge_of(scene)
        self.small = _small(scene)
        self.node_steps = 0

    @cached_property
    def scales(self) -> Scales:
        return scales_of(build_model(self.small))

    @cached_property
    def fine(self) -> Found:
        """What the small mesh carries with so many nodes that it counts as true. Raises `Diverged`."""
        setting = trials_of(self.scene).fine(self.scene)
        outcome = self._run(setting)
        if outcome.found is None:
            raise Diverged(f"the run of {setting.nodes_per_loop} nodes a loop that errors are estimated by: {outcome.message}")
        return outcome.found

    def errors(self, setting: Setting) -> Errors | None:
        """How far the scene is off at a setting; None where the small mesh does not come to rest."""
        found = self._run(setting).found
        if found is None:
            return None
        return self._scaled(errors_of(found, self.fine, self.scales))

    def errors_of_run(self, found: Found, setting: Setting) -> Errors | None:
        """How far a run of the scene at a setting is off, which found this.

        A periodic tile and a hook are compared with the fine run themselves; of a gripped mesh only a smaller one can be.
        """
        if self.edge == "gripped":
            return self.errors(setting)
        repeats = self._repeats(self.scene) / self._repeats(self.small)
        one = replace(found, contact_force_sum_N=found.contact_force_sum_N / repeats)
        return errors_of(one, self.fine, self.scales)

    def _run(self, setting: Setting) -> Outcome:
        outcome = run_point(lambda: with_setting(self.small, setting), watch=lambda _progress: None)
        self.node_steps += outcome.node_steps
        return outcome

    @staticmethod
    def _repeats(scene: Scene) -> int:
        return scene.knit.repeats[0] * scene.knit.repeats[1]

    def _scaled(self, errors: Errors) -> Errors:
        """Errors of a gripped mesh from those of a smaller one: what grips add to means goes with one over the size."""
        if self.edge != "gripped":
            return errors
        share = min(1.0, min(self.small.knit.repeats) / min(self.scene.knit.repeats))
        return replace(errors, active_percent=share * errors.active_percent, tension=share * errors.tension,
                       contact_force=share * errors.contact_force)  # fmt: skip


def bound_percent(errors: Errors) -> float:
    """[%] that the true errors should stay under, the largest of them."""
    return SAFETY * errors.largest_percent + FLOOR_PERCENT


def choose_setting(pilot: Pilot, percent: float) -> tuple[Setting, Errors]:
    """The cheapest setting whose errors stay under `percent`, or the best of those tried; and what it misses."""
    best: tuple[Setting, Errors] | None = None
    for setting in trials_of(pilot.scene).settings(pilot.scene, percent):
        errors = pilot.errors(setting)
        if errors is None:
            continue
        if best is None or errors.largest_percent < best[1].largest_percent:
            best = setting, errors
        if bound_percent(errors) <= percent:
            return setting, errors
    if best is None:
        raise Diverged("no setting was found at which a small mesh of this scene comes to rest")
    return best


def _small(scene: Scene) -> Scene:
    """The scene of the small mesh: nothing is written of it."""
    output = scene.output if scene.depends_on_path else replace(scene.output, frames=min(scene.output.frames, LEVELS))
    solver = replace(scene.solver, drive="relax")
    small = replace(scene, output=output, solver=solver)
    if scene.hook is not None or scene.knit.scatter:
        return small
    repeats = (1, 1)
    if scene.model.boundary == "gripped":
        columns, rows = scene.knit.repeats
        repeats = min(PATCH, columns), min(PATCH, rows)
    stages = tuple(replace(stage, pull=(), temperature_gradient=(0.0, 0.0)) for stage in scene.stages)
    return replace(small, knit=replace(scene.knit, repeats=repeats), panel=PanelOptions(), stages=stages)
