"""A strip pulled along one direction, its sides free: endless cloth at the strain at which it carries no tension across.

A run under tension is refused with friction or yield, whose states depend on the load history: a search would be part of it. Here
every trial of a level starts from the accepted level before, so that only the accepted strains are history. A level that does not
converge, or in which the wires tighten too much, is tried again with another step. Where the tension across changes its sign by a
jump of loops, no step has a strain at which there is none: the strip then takes the state behind the jump into its history, and
goes on from there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from loop_set import releases

from warpknit import measure
from warpknit.base.errors import Diverged, WarpknitError
from warpknit.measure import tension_scale
from warpknit.mesh.rim import LoadPoint
from warpknit.scene import Scene
from warpknit.scene.wire import Wire
from warpknit.solve.model import build_model
from warpknit.solve.relax import Relaxation
from warpknit.solve.simulate import Simulation

WEFT, WARP = 0, 1
FREE = 0.02  # of the tension along the pull: tension across that counts as none
FLOOR = 0.01  # EI/C^3: tensions below it count as none
TRIALS = 12  # strains across, a level
STEP_ACROSS = 0.02  # strain across between two trials, at most
STEPS = (1.0, 0.5, 0.25, 0.12, 1.5)  # of the step of the strain, tried one after the other; the last passes over a jump of loops
SHORTEST = 3  # of STEPS
NO_STRAIN = "no strain across"  # the ending where none was found without tension across
TIGHTER, TIGHT = 1.6, 100e6  # largest factor of the axial stress between two levels beyond so much [Pa]


@dataclass(frozen=True)
class Level:
    """A state of a strip; forces over the width as knitted, as a laboratory gives them."""

    strain: float  # along the pull
    strain_across: float
    force: float  # [N/m] along the pull, over the width as knitted
    axial: float  # [Pa] largest axial stress, of the sections of all ends
    fibre: float  # [Pa] largest stress of a fibre: axial and bending
    active: float  # [%] of the places where wires hook


@dataclass(frozen=True)
class Pull:
    """The levels of a pull, and why it ended."""

    levels: tuple[Level, ...]
    ending: str  # strength | end | steps | the class of the error
    steps: int
    said: str = ""  # by the last attempt, where none had a result

    def strain_at(self, force: float) -> float:
        """Strain from which the strip carries a force [N/m], between two levels; nan if it never does."""
        for before, after in zip(self.levels, self.levels[1:], strict=False):
            if after.force >= force > before.force:
                share = (force - before.force) / (after.force - before.force)
                return before.strain + share * (after.strain - before.strain)
        return math.nan

    def force_at(self, axial: float) -> float:
        """Force [N/m] at an axial stress [Pa], between two levels or beyond the last; nan without stress."""
        for before, after in zip(self.levels, self.levels[1:], strict=False):
            if after.axial >= axial > before.axial:
                share = (axial - before.axial) / (after.axial - before.axial)
                return before.force + share * (after.force - before.force)
        last = self.levels[-1]
        return last.force * axial / last.axial if last.axial > 0.0 else math.nan


def section_area(wire: Wire) -> float:
    """[m2] of all ends, without plating."""
    return wire.ends * math.pi * wire.radius**2


def pull(
    scene: Scene,
    axis: int,
    end: float,
    *,
    step: float = 0.02,
    strength: float = math.inf,
    steps: int = 200_000,
    held: bool = False,
) -> Pull:
    """Pull a tile along an axis. Up to a strain, stress `strength` [Pa] or number of steps. `held`: at the width as
    knitted, in place of free sides.
    """
    fraction = scene.wire.set_fraction
    simulation = Simulation(build_model(scene.changed({"wire.set_fraction": 1.0})))
    strip = _Strip(simulation, axis, held)
    levels = [strip.first_level(fraction)]
    tried, ending, said = 0, "end", ""
    while levels[-1].strain < end - 1e-9:
        if strip.progress.steps > steps:
            ending = "steps"
            break
        before = strip.relaxation.snapshot()
        try:
            is_jump = tried == len(STEPS)
            factor = 1.0 if is_jump else STEPS[tried]
            found = strip.advance(levels, min(levels[-1].strain + factor * step, end), jumps=is_jump)
        except WarpknitError as error:
            found, failure, said = None, type(error).__name__, str(error)
        else:
            failure, said = NO_STRAIN, NO_STRAIN
        if found is None or (found.axial > TIGHTER * max(levels[-1].axial, TIGHT) and tried < SHORTEST):
            strip.restore(before)
            tried += 1
            if tried > len(STEPS) or (tried == len(STEPS) and failure != NO_STRAIN):
                ending = failure
                break
            continue
        strip.accept()
        levels.append(found)
        tried = max(0, min(tried, SHORTEST) - 1)
        if found.axial > strength:
            ending = "strength"
            break
    return Pull(tuple(levels), ending, strip.progress.steps, "" if ending in ("end", "steps", "strength") else said)


class _Strip:
    """The levels of a pull, on the relaxation of a simulation."""

    def __init__(self, simulation: Simulation, axis: int, held: bool) -> None:
        assert isinstance(simulation.drive, Relaxation)
        self.held = held
        self.simulation, self.relaxation, self.axis = simulation, simulation.drive, axis
        self.scene, self.progress = simulation.model.scene, simulation.progress
        self.floor = FLOOR * tension_scale(simulation.model)
        self.stiffness = 0.0  # [N/m] of the tension across by the strain across
        self.area = section_area(self.scene.wire)
        simulation.mechanics.search()
        self.relaxation.solve(LoadPoint(np.eye(2), self.scene.wire.reference_temperature))  # wires that overlap as knitted
        self.accept()
        self.progress.stage, self.progress.stage_index, self.progress.level = "pull", 1, 1  # not as knitted

    def first_level(self, fraction: float) -> Level:
        """The mesh at the length as knitted, with its loops set in part."""
        level = self.level(self.relaxation.mechanics.observe())
        for _ in releases(self.simulation, fraction):
            before = self.relaxation.snapshot()
            found = self.advance([level], 0.0)
            if found is None:
                self.restore(before)
                found = self.advance([level], 0.0, jumps=True)
            if found is None:
                raise Diverged("no strain across is found as knitted")
            self.accept()
            level = found
        return level

    def advance(self, levels: list[Level], strain: float, *, jumps: bool = False) -> Level | None:
        """The level at a strain along the pull; None where no strain across is found, with `jumps` on neither side of a jump."""
        last = levels[-1]
        across, slope = last.strain_across, 0.0
        if self.held:
            return self.level(self._solve(strain, across))
        if len(levels) > 2:
            slope = (across - levels[-2].strain_across) / (last.strain - levels[-2].strain)
        across = max(across + slope * (strain - last.strain), -0.99)
        tried: list[tuple[float, float]] = []  # strain and tension across
        found = self._search(strain, across, tried)
        if found is None and jumps:
            contracts = tried[-1][0] < last.strain_across  # to the snap-through under tension across
            behind = [a for a, t in tried if (t < 0.0 if contracts else t > 0.0)]
            if behind:
                across = max(behind) if contracts else min(behind)
                self._solve(strain, across)
                self.accept()
                found = self._search(strain, across, [])
        return found

    def _search(self, strain: float, across: float, tried: list[tuple[float, float]]) -> Level | None:
        """The level without tension across, searched from a strain across on; the state before if there is none."""
        before = self.relaxation.snapshot()
        for trial in range(TRIALS):
            if trial and self.scene.contact.friction > 0.0:
                self.relaxation.restore(before)
            observed = self._solve(strain, across)
            tension = self.relaxation.mesh_tension(observed)
            along, sideways = float(tension[self.axis]), float(tension[1 - self.axis])
            if abs(sideways) <= FREE * max(abs(along), self.floor):
                return self.level(observed)
            tried.append((across, sideways))
            across = self._next(tried)
        self.relaxation.restore(before)
        return None

    def _next(self, tried: list[tuple[float, float]]) -> float:
        """Strain across to try next: a bounded secant step, within the strains that bracket no tension."""
        across, sideways = tried[-1]
        if len(tried) > 1 and tried[-2][0] != across:
            slope = (sideways - tried[-2][1]) / (across - tried[-2][0])
            self.stiffness = slope if slope > 0.0 else self.stiffness
        self.stiffness = self.stiffness or max(abs(sideways) / 2e-3, self.floor)
        there = across - float(np.clip(sideways / self.stiffness, -STEP_ACROSS, STEP_ACROSS))
        slack = max((a for a, t in tried if t < 0.0), default=-math.inf)
        tight = min((a for a, t in tried if t > 0.0), default=math.inf)
        if slack < tight and math.isfinite(tight - slack) and not slack < there < tight:
            there = 0.5 * (slack + tight)
        return max(there, -0.99)

    def _solve(self, strain: float, across: float) -> measure.Observables:
        strains = np.array([across, strain] if self.axis == WARP else [strain, across])
        self.progress.load_factor = strain
        self.relaxation.solve(LoadPoint(np.diag(1.0 + strains), self.scene.wire.reference_temperature))
        return self.relaxation.mechanics.observe()

    def accept(self) -> None:
        """Take the state into the load history."""
        self.relaxation.mechanics.advance_history()

    def restore(self, kept: dict[str, np.ndarray]) -> None:
        """Return to an earlier state, in the middle of no level."""
        self.relaxation.restore(kept)
        self.progress.solving = False

    def level(self, observed: measure.Observables) -> Level:
        """The values of a state."""
        strains = np.diag(observed.gradient) - 1.0
        force = float(self.relaxation.mesh_tension(observed)[self.axis] * (1.0 + strains[1 - self.axis]))
        axial = float(np.max(observed.axial_strain)) * self.scene.wire.axial_stiffness / self.area
        fibre = float(measure.stress_extremes(observed)[0])
        active = float(measure.contacts(observed).active_percent)
        return Level(float(strains[self.axis]), float(strains[1 - self.axis]), force, axial, fibre, active)
