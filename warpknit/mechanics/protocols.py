"""What the engine needs of a model to load, step, check and record it.

`Model` is constant, a state moves, `Mechanics` loads and observes one world. `Worlds` (worlds.py) steps and checks worlds, one or
many side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..compute.kept import Owner
from ..measure import MeshModel
from ..mesh.rim import LoadPoint, Rim


class Model(MeshModel, Protocol):
    """A mesh ready to run: all constant data."""

    @property
    def table(self) -> Any: ...  # rest data of one repeat at its nodes; None for wires from a file
    @property
    def bodies(self) -> np.ndarray: ...  # [body] index in the mesh of all ranks; `panel` is the strip of this rank
    @property
    def loop_length(self) -> float: ...  # [m] of wire
    @property
    def limited_by(self) -> str: ...  # limit of the time step, in words
    @property
    def loading_time(self) -> float: ...  # [s] of a stage of a ramp


@dataclass(frozen=True)
class Drift:
    """Criterion for the drift of the tension in an equilibrium.

    The change over `checks` checks is extrapolated as a geometric series, with the ratio of two successive changes, at most
    `max_decay_ratio`. With a ratio of 0 the change itself is the estimate.
    """

    checks: int
    max_decay_ratio: float = 0.0

    @property
    def required_checks(self) -> int:
        """Convergence checks before the criterion applies."""
        return (2 if self.max_decay_ratio > 0.0 else 1) * self.checks


@dataclass(frozen=True)
class Check:
    """Result of a convergence check."""

    residual: np.ndarray  # [row] out-of-balance force and motion, for solver.residual_tolerance; nan during loading
    ratio: np.ndarray  # [row] largest of all criteria over its tolerance: converged below 1; inf during loading


class Mechanics(Protocol):
    """One world of a group. Methods change only what they document; the defaults are of a mesh that stays in its plane."""

    group: Any  # the `Worlds` of this world
    rows: np.ndarray  # [1] its index there
    model: Any
    state: Any
    notes: list[str]  # for the user
    drift: Drift
    can_overlap: bool = False  # wires may pass through each other
    may_overlap: bool = False  # wires may overlap now, as knitted
    check_steps: int  # steps between convergence checks of a relaxation
    path_increment: float  # largest strain increment of the smallest mesh, whose equilibrium may depend on the load path
    path_ratios: tuple[float, float]  # residual over its tolerance to which it converges in increments on the way, and at the end

    @property
    def rim(self) -> Rim | None:
        """The edge, where the mechanics moves it, else None: the drive moves it with the membrane (solve/multilevel.py)."""
        return None

    @property
    def stations(self) -> np.ndarray:
        """(station, 2 or 3) [m] displacement of the edge from the affinely mapped outline; empty without a rim."""
        return np.zeros((0, 2))

    def compile(self) -> None:
        """Compile every kernel of a run by launching it; the state may change. Raises `ModelError`."""

    # --- loads

    def set_load(self, load: LoadPoint, steps: int, *, evenly: bool = False) -> None:
        """Apply a load over `steps` steps, smoothly or `evenly`; at once with 0 steps."""

    def _begin_ramp(self, load: LoadPoint, steps: int, *, evenly: bool) -> float:
        """Let the control array apply a load over `steps` steps, at once with none; return the length factor of the wires."""
        steering, factor = self.state.steering, self.model.scene.wire.length_factor(load.temperature)
        begin, end, share = steering.load, np.array([*load.gradient.ravel(), factor]), float(steps == 0)
        steering.set(
            ramp_from=begin, ramp_to=end, ramp_step=0.0, ramp_steps=float(steps), even_ramp=float(evenly), ramp_share=share
        )
        if steps == 0:
            steering.load = end
        return float(factor)

    def stiffen_contacts(self, factor: float, most: float) -> bool:
        """Multiply the stiffness of contacts while loads are applied; False where it would exceed `most` times the usual one."""
        return False

    def load_steps(self, load: LoadPoint, predicted: bool) -> int:
        """Steps over which the load of a level is applied."""

    @property
    def release_parts(self) -> int:
        """Number of increments of the natural shape before the first record (`wire.set_fraction`, or a file's)."""
        return 1

    def release(self, begin: float, end: float) -> None:
        """Apply the natural curvature and twist from one share to another: 0 as knitted, 1 as in the scene."""
        return

    def predict(self, ratio: float) -> None:
        """Extrapolate the state by `ratio` times its last increment, and store it; set velocities to zero."""

    def rub(self, rubs: bool) -> None:
        """Whether wires rub from now on: not while they are at rest as knitted, to where they came by no motion of theirs."""
        return

    def advance_history(self) -> None:
        """Update the history variables (friction, yield) from an equilibrium."""

    @property
    def dissipated(self) -> float:
        """[J] dissipated since the start by friction and yield."""

    # --- steps

    def search(self) -> None:
        """Search neighbours, and reset the travel budget."""
        self.group.search(self.rows)

    def step(self, count: int) -> None:
        """Take steps; a frozen state (kernels/control.py) does not change."""

    def overlap(self) -> float:
        """Largest overlap of wires since the last call, over their thickness."""
        return float(self.group.overlap(self.rows)[0])

    def deepest_overlap(self) -> str:
        """Deepest overlap in words: wires, place, and a changed stiffness there."""
        return ""

    def fastest(self) -> tuple[int, int]:
        """Wire and node of the largest speed."""

    # --- convergence of a relaxation

    def begin_level(self) -> None:
        """Start a load level: reset the multiplier rates."""

    def begin_test(self, *, is_certain: bool) -> None:
        """Test the stability of the next equilibrium: after a sufficient change of load, or if `is_certain`."""
        return

    @property
    def has_left(self) -> bool:
        """Whether the mesh left an unstable equilibrium in this level."""
        return False

    def stress(self) -> np.ndarray:
        """(2, 2) [N/m] nominal stress of the mesh."""
        return np.asarray(self.group.stress(self.rows)[0])

    def causes(self) -> str:
        """Likely causes of non-convergence beside the stress, after a comma; may be empty."""
        return ""

    def is_in_equilibrium(self, load: LoadPoint) -> bool:
        """Whether the mesh is as knitted, without load, stress and overlaps; overlaps are added to `notes`."""

    # --- real time

    def renew_time_step(self, steps: int) -> float:
        """Set and return a time step [s] stable for the next `steps` steps."""

    def residual_now(self) -> float:
        """Out-of-balance force and motion, for solver.residual_tolerance."""

    # --- observation

    def observe(self) -> Any:
        """Observables of the state (measure/observables.py)."""

    def edge_work_terms(self, observed: Any) -> list[tuple[np.ndarray, np.ndarray]]:
        """Pairs (force, displacement) of the edge work: clamps and uneven thermal strain."""

    @property
    def owners(self) -> list[Owner]:
        """Owners of variables of mesh and solver that outlast a step."""

    # --- large meshes, which start from smaller ones and are corrected as membranes (solve/multilevel.py)

    def prolongation(self, smaller: Any) -> Any:
        """`RepeatProlongation` to this mesh from the mechanics of a smaller one."""

    def membrane_grid(self, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> Any:
        """`MembraneGrid` that balances the mesh as a membrane: `cells` (2,) from `low` (2,) [m], each of size `cell` (2,) [m]."""

    def state_variables(self) -> dict[str, np.ndarray]:
        """Fields of the state (warpknit/mechanics/), for differences between states."""

    @property
    def checked_stress(self) -> np.ndarray:
        """(2, 2) [N/m] nominal stress, as the last convergence check found it."""
        return np.asarray(self.group.stress_now(self.rows)[0])

    def stop(self) -> None:
        """Stop all motion."""

    # --- an edge that moves with the membrane

    def move_clamps(self, begin: np.ndarray, end: np.ndarray) -> None:
        """Set displacements (clamp, 2) [m] of clamps at start and end of the next load."""
        return

    def move_stations(self, change: np.ndarray) -> None:
        """Move stations of a rim of the mechanics by (station, 3) [m], and the clamps with them."""
        return

    def clamp_forces(self) -> np.ndarray:
        """Forces (clamp, n) [N] of the wires at their clamps, from the last convergence check; n = 2 or 3."""

    def renew_damping(self) -> None:
        """Set the damping by the motion of the last steps."""
        return
