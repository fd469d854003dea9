"""What the two drives share: where a run stands, how a load is put on, records of states, and how a run fails."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .. import measure
from ..errors import Diverged
from ..kernels import control as c
from ..measure.edge_work import EdgeWork
from ..measure.strain import clamp_rotation, rotation, true_stress
from ..mechanics import Mechanics
from ..mesh.load_point import LoadPoint
from ..mesh.rim import Rim
from ..scene import Stage
from .equilibrium import DEEPEST
from .load import load_at, temperature_at
from .progress import LoadStart, Progress, Record


class Drive(ABC):
    """Takes a mesh through one stage after the other. `watch` is called after every convergence check and may raise to stop."""

    slower: str  # the key that has the load come on more slowly

    def __init__(self, mechanics: Mechanics, progress: Progress, watch: Callable[[Progress], None]) -> None:
        self.mechanics, self.progress, self.watch = mechanics, progress, watch
        self.scene = mechanics.model.scene
        self.left_out = 0.0  # stress over the tension, the most that corrections as a membrane were given up with
        uneven = any(any(stage.temperature_gradient) for stage in self.scene.stages)
        self.edge_work = EdgeWork() if uneven or self.scene.has_moving_edge else None

    @property
    def model(self) -> Any:
        return self.mechanics.model

    @property
    def state(self) -> Any:
        return self.mechanics.state

    @property
    def rim(self) -> Rim | None:
        """The edge, where it does more than follow the load."""
        return self.mechanics.rim

    @property
    def stations(self) -> np.ndarray:
        """(station, 2) [m] displacement of the edge from the affinely mapped outline."""
        return self.mechanics.stations

    @property
    @abstractmethod
    def dissipated(self) -> float:
        """[J] taken out since the start."""

    @abstractmethod
    def stage(self, stage: Stage) -> Iterator[Record]:
        """Records of one stage, from where `progress` stands. Raises `Diverged`."""

    def compile(self) -> None:
        """Have every kernel that the run needs compiled or loaded; everything stays as it is."""
        kept = self.snapshot()
        self.mechanics.compile()
        self.restore(kept)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Host copies of the state, of what is carried from check to check, and of the progress."""
        state = {f"state_{name}": value for name, value in self.state.arrays().items()}
        return self.state_dict() | state | {"progress": np.array(json.dumps(self.progress.as_dict()))}

    def restore(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `snapshot` returned."""
        self.state.restore({name[6:]: value for name, value in kept.items() if name.startswith("state_")})
        self.progress.__dict__.update(Progress.from_dict(json.loads(str(kept["progress"]))).__dict__)
        self.load_state_dict(kept)

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays that are carried from check to check."""
        kept = self.mechanics.state_dict() | {"left_out": np.array(self.left_out)}
        return kept | (self.edge_work.state_dict() if self.edge_work is not None else {})

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `state_dict` returned."""
        self.mechanics.load_state_dict(kept)
        self.left_out = float(kept["left_out"])
        if self.edge_work is not None:
            self.edge_work.load_state_dict(kept)

    # --- loads

    def load_now(self) -> LoadStart:
        """The load as it is, at the start of a stage."""
        index = self.progress.stage_index
        before = self.scene.stages[index - 1].temperature if index else self.scene.wire.reference_temperature
        gradient, stress = self.state.gradient, self.mechanics.stress()
        turned = rotation(clamp_rotation(gradient))
        tension = true_stress(turned @ stress, turned @ gradient)
        return LoadStart(gradient.ravel().tolist(), np.diag(tension).tolist(), before)

    def target(self, stage: Stage, factor: float) -> LoadPoint:
        """Load of a stage at a load factor; a direction driven by tension keeps the strain it has."""
        progress = self.progress
        return load_at(self.scene, progress.stage_index, stage, factor, progress.start, self.state.gradient, self.rim)

    # --- states

    def mesh_tension(self, observed: Any) -> np.ndarray:
        """Tensions (weft, warp) [N/m] of the mesh that the first rank has read."""
        return np.asarray(self.model.ranks.from_first(lambda: np.array(measure.mesh_tension(observed))))

    def record(self, stage: Stage, factor: float, *, steady: bool, work: float = 0.0) -> Record:
        """The state as it is."""
        progress = self.progress
        observables = self.mechanics.observe()
        edge_work = 0.0
        if self.edge_work is not None:
            edge_work = self.edge_work.account(*self.mechanics.edge_work_terms(observables))
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
            left_out=self.left_out,
            edge_work=edge_work,
            stations=self.stations.copy(),
            observables=observables,
        )
        progress.records += 1
        return record

    # --- failures

    def divergence(self) -> Diverged:
        """The error of a state whose numbers are lost."""
        wire, node = self.mechanics.fastest()
        return Diverged(
            f"diverged at step {self.progress.steps}: wire {wire}, node {node}, {self._where()}; likely the load comes on too"
            f" fast for the stiffness there: raise {self.slower}"
        )

    def overlap_error(self) -> Diverged | None:
        """The error of wires that may have passed through each other since the last check; none as knitted."""
        deepest = self.mechanics.overlap()
        if deepest <= DEEPEST or self.mechanics.may_overlap:
            return None
        return Diverged(
            f"wires overlap by {deepest:.2g} of their thickness at step {self.progress.steps}, {self._where()}: the contact"
            f" penalty does not hold them apart; raise {self.slower} or contact.stiffness"
        )

    def _where(self) -> str:
        control = self.state.read_control()
        strain = [control[int(c.GRADIENT)] - 1, control[int(c.GRADIENT) + 3] - 1]
        return f"stage {self.progress.stage!r}, weft strain {strain[0]:.3g}, warp strain {strain[1]:.3g}"
