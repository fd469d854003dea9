"""The drive `ramp` in space: real time and real (or scaled) masses.

A stage loads over `loading_time` and is then held until it is steady, as in the plane (solve/ramp_stage.py). Clamps move step by
step with the load. Segments keep their chords and the softening stays: energies are those of the softened wires.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from .. import measure
from ..kernels import control as c
from ..scene import Stage
from ..solve.drive import Progress
from ..solve.ramp_stage import RampStage, work_between
from .clamps import MovingClamps
from .drive import SpatialDrive, SpatialRecord
from .mesh import SpatialMesh
from .ramp_masses import ramp_numbers, step_now
from .steadiness import tension_scale

RESERVED = 0.25  # of the margin of a search, kept for what the load itself moves until the next one


class SpatialRamp(SpatialDrive, RampStage):
    """Runs the stages of a scene in real time; what it shares with a relaxation is its mesh, its contact and its records."""

    slower = "solver.loading_time"
    multipliers = False

    def __init__(
        self,
        mesh: SpatialMesh,
        watch: Callable[[Progress], None] = lambda _: None,
        *,
        progress: Progress | None = None,
    ) -> None:
        super().__init__(mesh, watch, progress=progress)
        numbers = ramp_numbers(mesh)
        self.mesh = replace(mesh, time_step=numbers.time_step, added_mass=numbers.added_mass)
        self.loading_time = numbers.loading_time
        self.state.node_mass.assign(numbers.node_mass)
        self.state.spin_inertia.assign(numbers.spin_inertia)
        self.stepper.set_time_step(numbers.time_step, numbers.damping)
        # two wires that fly at each other come nearer by half their thickness a step at most: they meet before they have passed
        farthest = 0.5 * float(mesh.rods.wire_radius.min())
        self.state.write_control({c.DRIVE: 1.0, c.SPEED_LIMIT: np.inf, c.STEP_LIMIT: farthest})
        self._searched_at = np.eye(2)  # gradient at the search that room was last kept by

    def _moving_clamps(self) -> MovingClamps | None:
        wires = self.mesh.wires
        if not len(wires.held_node):
            return None
        return self._clamps_that_move(np.zeros(0, dtype=np.int64) if wires.sliding_clamp is None else wires.sliding_clamp)

    def memory(self) -> dict[str, np.ndarray]:
        return super().memory() | {"searched_at": self._searched_at}

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        super().recall(kept)
        self._searched_at = kept["searched_at"].copy()

    def _stage(self, stage: Stage) -> Iterator[SpatialRecord]:
        yield from self.ramp_records(stage, self.scene.output.frames)

    def _keep(self, stage: Stage, factor: float, *, steady: bool) -> SpatialRecord:
        if self.progress.records == 0:
            self.progress.work = self._reading().energies.stored  # of wires that are not free of stress as knitted, or overlap
        return self._record(stage, factor, steady=steady)

    def _dissipated(self) -> float:
        return float(self.state.read_control()[int(c.DISSIPATED)])

    # --- the load

    def _aim(self, stage: Stage, factor: float, strain: np.ndarray | None, steps: int, *, evenly: bool) -> None:
        gradient = self._gradient(stage, factor)
        if strain is not None:
            gradient[np.diag_indices(2)] = np.where(stage.by_tension, 1.0 + strain, np.diag(gradient))
        self._bring_on(gradient, self.scene.wire.length_factor(self._temperature(stage, factor)), steps)
        self.state.write_control({c.EVEN_RAMP: float(evenly)})

    def _begin_ramp(self) -> None:
        self.contact.take_deepest()
        self._reserve(self.state.gradient)

    def _reserve_for_ramp(self, control: np.ndarray) -> None:
        gradient = control[int(c.GRADIENT) : int(c.GRADIENT) + 4].reshape(2, 2)
        if 2.0 * np.abs(gradient - self._searched_at).max() > self.contact.strain_within(RESERVED):
            self._reserve(gradient.copy())

    def _reserve(self, gradient: np.ndarray) -> None:
        """Search, and keep room for what the load will move."""
        self.contact.expect(self.contact.strain_within(RESERVED))
        self._searched_at = gradient

    def _account_work(self) -> None:
        reading = self._reading()
        now = [*reading.nominal_stress.ravel().tolist(), reading.thermal_force]
        now += [*reading.gradient.ravel().tolist(), reading.length_factor]
        if self.progress.stress:
            self.progress.work += work_between(self.progress.stress, now, self.mesh.panel.area)
        self.progress.stress = now

    def _tension_scale(self) -> float:
        return tension_scale(self.mesh)

    def _carried(self) -> tuple[np.ndarray, np.ndarray]:
        reading = self._reading()
        return np.diag(reading.gradient) - 1.0, np.array(measure.mesh_tension(reading))

    # --- steps

    def _control(self) -> np.ndarray:
        return self.state.read_control()

    def _renew_step(self, looks: int) -> float:
        self.stepper.evaluate()
        step = step_now(self.mesh, self.rest)
        self.state.write_control({c.TIME_STEP: step})
        return step

    def _advance(self, steps: int) -> None:
        self.progress.steps += self.contact.advance(steps)
        self.stepper.evaluate()
        self._refuse_divergence(may_overlap=False)

    def _is_steady(self, control: np.ndarray) -> bool:
        self.progress.residual = self.steadiness.unrest()
        return self._rests()
