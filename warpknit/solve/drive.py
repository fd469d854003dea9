"""Common part of the two drives: progress, loads, records, errors."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .. import measure
from ..base.errors import Diverged, Overlapped
from ..base.text import engineering, percent
from ..compute.kept import Kept, Owner, restore, save
from ..measure.strain import EdgeWork, clamp_rotation, rotation, stretch, true_stress
from ..measure.table import Record
from ..mechanics.numerics import MAX_OVERLAP
from ..mechanics.protocols import Mechanics
from ..mesh.rim import LoadPoint, Rim
from ..scene import Stage
from .progress import LoadStart, Progress
from .stage_load import temperature_at


class Drive(ABC):
    """Runs the stages of a scene. `monitor` is called after every convergence check and may raise to stop."""

    rate_key: str  # the scene key to raise for slower loading
    KEPT: tuple[str, ...] = ("edge_work",)

    def __init__(self, mechanics: Mechanics, progress: Progress, monitor: Callable[[Progress], None]) -> None:
        self.mechanics, self.progress, self.monitor = mechanics, progress, monitor
        self.model: Any = mechanics.model
        self.state: Any = mechanics.state
        self.scene = self.model.scene
        uneven = any(any(stage.temperature_gradient) for stage in self.scene.stages)
        self.edge_work = EdgeWork() if uneven or self.scene.has_moving_edge else None

    @property
    def notes(self) -> list[str]:
        """Notes about the mesh, for the user."""
        return self.mechanics.notes

    @property
    def rim(self) -> Rim | None:
        """The edge, where it moves relative to the load, else None."""
        return self.mechanics.rim

    @property
    def stations(self) -> np.ndarray:
        """(station, 2) [m] displacement of the edge from the affinely mapped outline."""
        return self.mechanics.stations

    @property
    def dissipated(self) -> float:
        """[J] since the start."""
        return self.mechanics.dissipated

    @abstractmethod
    def stage(self, stage: Stage) -> Iterator[Record]:
        """Records of one stage, from where `progress` stands. Raises `Diverged`."""

    def compile(self) -> None:
        """Compile or load every kernel of the run; the state does not change."""
        kept = self.snapshot()
        self.mechanics.compile()
        self.restore(kept)

    def snapshot(self) -> Kept:
        """State, solver variables and progress, to continue from elsewhere."""
        return self.state_dict() | {"progress": np.array(json.dumps(vars(self.progress), default=vars))}

    def restore(self, kept: Kept) -> None:
        """Restore a snapshot."""
        self.load_state_dict(kept)
        self.progress.__dict__.update(Progress.from_dict(json.loads(str(kept["progress"]))).__dict__)

    @property
    def owners(self) -> list[Owner]:
        """Owners of variables of mesh and solver that outlast a step."""
        return [*self.mechanics.owners, Owner(self)]

    def state_dict(self, *, copied: bool = True) -> Kept:
        """State and solver variables, for a checkpoint; not `copied`: on a CPU valid until the next step."""
        return save(*self.owners, copied=copied)

    def load_state_dict(self, kept: Kept) -> None:
        """Restore a `state_dict`."""
        restore(kept, *self.owners)

    def advance(self, steps: int) -> None:
        """Take time steps, with searches in between. Raises `Diverged`."""
        taken, diverged = self.mechanics.group.advance(self.mechanics.rows, steps)
        self.progress.steps += int(taken[0])
        if diverged[0]:
            raise self.divergence()

    # --- loads

    def stages(self) -> Iterator[Stage]:
        """The stages from `progress` on; one ends where the next is asked for."""
        progress = self.progress
        while progress.stage_index < len(self.scene.stages):
            stage = self.scene.stages[progress.stage_index]
            progress.stage = stage.name
            if not progress.start.gradient:
                progress.start = self.load_now()
            yield stage
            progress.stage_index += 1
            progress.level, progress.start, progress.time = 0, LoadStart(), 0.0

    def load_now(self) -> LoadStart:
        """The current load, at the start of a stage."""
        index = self.progress.stage_index
        before = self.scene.stages[index - 1].temperature if index else self.scene.wire.reference_temperature
        gradient, stress = self.state.gradient, self.mechanics.stress()
        turned = rotation(clamp_rotation(gradient))
        tension = true_stress(turned @ stress / self.model.panel.clamp_share, turned @ gradient)
        return LoadStart(gradient.ravel().tolist(), np.diag(tension).tolist(), before)

    def target(self, stage: Stage, factor: float) -> LoadPoint:
        """Load of a stage at a load factor.

        Directions driven by tension keep their strain. The first stage raises the edge to its paraboloid.
        """
        scene, rim, index, start = self.scene, self.rim, self.progress.stage_index, self.progress.start
        start_gradient = np.array(start.gradient).reshape(2, 2)
        turn, first, now = clamp_rotation(start_gradient), stretch(start_gradient), stretch(self.state.gradient)
        there = first.copy()
        expansion = 1.0 + scene.model.frame_expansion * (stage.temperature - scene.wire.reference_temperature)
        for axis, strain in enumerate((stage.strain_weft, stage.strain_warp)):
            end = (1.0 + strain) * expansion if strain is not None else None
            there[axis, axis] = now[axis, axis] if end is None else (1 - factor) * first[axis, axis] + factor * end
        there[0, 1] = (1 - factor) * first[0, 1] + factor * stage.shear * expansion
        turn += factor * (stage.clamp_rotation - turn)
        before = scene.stages[index - 1] if index else None
        slope = np.array(before.temperature_gradient if before else (0.0, 0.0))
        slope = (1 - factor) * slope + factor * np.array(stage.temperature_gradient)
        stations, raised = None, 0.0
        if rim is not None:
            raised = 0.0 if scene.panel.focal_length is None else 1.0 if index else factor
            stations = (1 - factor) * rim.pulled(before.pull if before else ()) + factor * rim.pulled(stage.pull)
        temperature = temperature_at(stage, start, factor)
        return LoadPoint(rotation(-turn) @ there, temperature, tuple(slope.tolist()), stations, raised=raised)

    # --- states

    def mesh_tension(self, observed: Any) -> np.ndarray:
        """Tensions (weft, warp) [N/m] of the mesh, from the first rank."""
        return np.asarray(self.model.ranks.from_first(lambda: np.array(measure.mesh_tension(observed))))

    def record(self, stage: Stage, factor: float, *, steady: bool, work: float = 0.0) -> Record:
        """Record of the current state."""
        progress = self.progress
        observables = self.mechanics.observe()
        edge_work = 0.0
        if self.edge_work is not None:
            edge_work = self.edge_work.add(*self.mechanics.edge_work_terms(observables))
        record = Record(
            index=progress.records,
            stage=stage.name,
            stage_index=progress.stage_index,
            load_factor=factor,
            temperature=temperature_at(stage, progress.start, factor),
            steps=progress.steps,
            steady=steady,
            work=work,
            dissipated=self.dissipated,
            edge_work=edge_work,
            stations=self.stations.copy(),
            observables=observables,
        )
        progress.records += 1
        return record

    # --- failures

    def divergence(self) -> Diverged:
        """The error of a diverged state."""
        wire, node = self.mechanics.fastest()
        cause = f"raise {self.rate_key}: the load is probably applied too fast"
        is_loaded = self.progress.load_factor > 0.0 or not np.array_equal(self.state.gradient, np.eye(2))
        if self.progress.stage_index == 0 and not is_loaded:
            cause = "change the shape of the wires: unloaded, they overlap too deeply or are stretched too far"
            if self.scene.wire.set_fraction < 1.0:
                cause = "raise wire.set_fraction: the released wires spring apart too fast"
        return Diverged(f"diverged at step {self.progress.steps}: wire {wire}, node {node}, {self._where()}; {cause}")

    def overlap_error(self, overlap: float) -> Overlapped | None:
        """Error of wires that may have crossed, by overlap over thickness; or None."""
        if overlap <= MAX_OVERLAP or self.mechanics.may_overlap:
            return None
        causes = self._causes()
        remedy = "raise" if not causes else "give a smaller load, or raise"
        return Overlapped(
            f"wires overlap by {overlap:.2g} of their thickness at step {self.progress.steps}, {self._where()},"
            f" {self.mechanics.deepest_overlap()}{causes}; {remedy} {self.rate_key} or contact.stiffness"
        )

    def _causes(self) -> str:
        """Likely causes of non-convergence, after a comma; may be empty."""
        observed, strength = self.mechanics.observe(), self.scene.wire.tensile_strength
        stress = self.model.ranks.from_first(lambda: measure.largest_stress(observed))
        exceeded = f", wire stress {engineering(stress, 'Pa')} exceeds the strength" if stress > strength else ""
        return exceeded + self.mechanics.causes()

    def _where(self) -> str:
        strain = np.diag(self.state.gradient) - 1.0
        return f"load step {self.progress.stage!r}, weft strain {percent(strain[0])}, warp strain {percent(strain[1])}"
