"""The protocols by which the engine loads, steps, checks and records a model.

`Model` is constant, a state moves, `Mechanics` steps a state. A `Group` steps many states of one model side by side;
`SingleMesh` is a group of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..base.text import engineering
from ..compute.kept import Owner
from ..compute.steering import Steering
from ..measure import MeshModel
from ..mesh.rim import LoadPoint, Rim


class Model(MeshModel, Protocol):
    """A mesh ready to run: all constant data."""

    @property
    def table(self) -> Any:
        """Rest data of one repeat at its nodes; None for wires from a file."""

    @property
    def bodies(self) -> np.ndarray:
        """[body] index in the mesh of all ranks; `panel` is that of the strip of this rank."""

    @property
    def softening(self) -> float:
        """EA over the axial stiffness of the dynamics."""

    @property
    def loop_length(self) -> float:
        """[m] of wire."""

    @property
    def time_step(self) -> float:
        """[s] initial time step."""

    @property
    def limited_by(self) -> str:
        """What limits the time step."""

    @property
    def loading_time(self) -> float:
        """Loading time [s] of a stage of a ramp."""


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
    """Result of a convergence check; arrays [mesh] for many meshes."""

    residual: Any  # out-of-balance force and motion, for solver.residual_tolerance; nan during loading
    ratio: Any  # largest of all criteria over its tolerance: converged below 1; inf during loading


class Mechanics(Protocol):
    """Steps one mesh. Methods change only what they document."""

    notes: list[str]  # for the user
    may_overlap: bool  # wires may overlap now, as knitted
    check_steps: int  # steps between convergence checks of a relaxation
    path_increment: float  # largest strain increment of the smallest mesh, whose equilibrium may depend on the load path
    path_ratios: tuple[float, float]  # residual over its tolerance to which it converges in increments on the way, and at the end

    @property
    def drift(self) -> Drift:
        """Criterion for the drift of the tension."""

    @property
    def can_overlap(self) -> bool:
        """Whether wires may pass through each other."""

    @property
    def group(self) -> Any:
        """The group of which this is a mesh."""

    @property
    def model(self) -> Any: ...
    @property
    def state(self) -> Any: ...
    @property
    def rim(self) -> Rim | None:
        """The edge, where the mechanics moves it, else None."""

    @property
    def stations(self) -> np.ndarray:
        """(station, 2) [m] displacement of the edge from the affinely mapped outline; empty without a rim."""

    def compile(self) -> None:
        """Compile every kernel of a run by launching it; the state may change."""

    # --- loads

    def set_load(self, load: LoadPoint, steps: int, *, evenly: bool = False) -> None:
        """Apply a load over so many steps, smoothly or `evenly`; at once with 0 steps."""

    def load_steps(self, load: LoadPoint, predicted: bool) -> int:
        """Steps over which the load of a level is applied."""

    @property
    def release_parts(self) -> int:
        """Equilibria before the first record in which the natural shape is applied (`wire.set_fraction`, or that of a file)."""

    def release(self, begin: float, end: float) -> None:
        """Apply it from one share to another: natural curvature and twist go from those as knitted to those of the scene."""

    def predict(self, ratio: float) -> None:
        """Extrapolate the state by `ratio` times its last increment, and store it; set velocities to zero."""

    def advance_history(self) -> None:
        """Update the history variables (friction, yield) from an equilibrium."""

    @property
    def dissipated(self) -> float:
        """[J] dissipated since the start by friction and yield."""

    # --- steps

    def search(self) -> None:
        """Search neighbours, and reset the travel budget."""

    def step(self, count: int) -> None:
        """Take steps; a frozen state (kernels/control.py) does not change."""

    def overlap(self) -> float:
        """Largest overlap of wires since the last call, over their thickness."""

    def deepest_overlap(self) -> str:
        """Wires and place of the deepest overlap now, and the stiffness there if it is not that of the scene, in words."""

    def fastest(self) -> tuple[int, int]:
        """Wire and node of the largest speed."""

    # --- convergence of a relaxation

    def begin_level(self) -> None:
        """Start a load level: reset the multiplier rates."""

    def begin_test(self, *, is_certain: bool) -> None:
        """Test whether the next equilibrium is stable, where the model does, if the load has changed enough or `is_certain`."""

    @property
    def has_left(self) -> bool:
        """Whether the mesh has left an equilibrium of this level that was not stable."""

    def check(self, checks: int, *, loading: bool) -> Check:
        """Check convergence, and update damping and multipliers.

        `checks`: those of the level so far, this one included.
        """

    def renew(self, checks: int) -> None:
        """Update stiffnesses and masses to the current load."""

    def stress(self) -> np.ndarray:
        """(2, 2) [N/m] nominal stress of the mesh."""

    def causes(self) -> str:
        """Likely causes of non-convergence, after a comma; may be empty."""

    def is_in_equilibrium(self, load: LoadPoint) -> bool:
        """Whether the mesh as knitted is in equilibrium under a load."""

    # --- real time

    def renew_time_step(self, steps: int) -> float:
        """Set and return a time step [s] stable for the next `steps` steps."""

    def reserve_for_load(self) -> None:
        """Search neighbours, with a margin for the motion of the load."""

    def follow_load(self) -> None:
        """Search again before the load uses up that margin."""

    def residual_now(self) -> float:
        """Out-of-balance force and motion, for solver.residual_tolerance."""

    # --- observation

    def observe(self) -> Any:
        """Observables of the state (measure/observables.py)."""

    def edge_work_terms(self, observed: Any) -> list[tuple[np.ndarray, np.ndarray]]:
        """Pairs (force, displacement) of the edge work: clamps and uneven thermal strain."""

    @property
    def owners(self) -> list[Owner]:
        """What has variables of the mesh and its solver that outlast a step."""

    # --- large meshes, which start from smaller ones and are corrected as membranes (solve/multilevel.py); `rim` is None

    def prolongation(self, smaller: Any) -> Any:
        """Prolongation from a smaller mesh of the same knit, given by its mechanics, to this one.

        Its `carry(response)` adds what changed on the smaller mesh since the last time; `response`: of the cloth at the load. It
        returns False where the larger mesh cannot take it, and keeps its state.
        """

    def membrane_grid(self, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> Any:
        """A grid of `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m], which balances the mesh as a membrane.

        It has the largest strain of one correction `max_strain`, and the smallest displacement out of the plane that is worth one
        `least_lift` [m]. `gather()` returns the out-of-balance forces (grid node, 2) [N] that the last convergence check found,
        `gather_across()` those out of the plane [grid node] [N], None in a planar model. `spread(displacement, response)` moves
        the mesh with the grid (grid node, 2) [m], its repeats as endless cloth answers, `spread_across(displacement)` out of its
        plane [grid node] [m]; the clamps stay.
        """

    def state_variables(self) -> dict[str, np.ndarray]:
        """Fields of the state (warpknit/mechanics/), for differences between states."""

    @property
    def checked_stress(self) -> np.ndarray:
        """(2, 2) [N/m] nominal stress, as the last convergence check found it."""

    def stop(self) -> None:
        """Stop all motion."""

    # --- an edge that moves with the membrane

    def move_clamps(self, begin: np.ndarray, end: np.ndarray) -> None:
        """Have the next load take the clamps from displacements (clamp, 2) [m] to others."""

    def clamp_forces(self) -> np.ndarray:
        """(clamp, 2) [N] by which the wires pull at their clamps, as the last convergence check found them."""

    def renew_damping(self) -> None:
        """Set the damping by the motion of the last steps."""


class Group(Protocol):
    """Meshes of one model, stepped and checked independently. `rows` are indices of some of them."""

    keeps_equilibria: bool  # whether a mesh may return to an earlier state

    @property
    def model(self) -> Any: ...
    @property
    def members(self) -> Sequence[Mechanics]: ...

    def together(self) -> AbstractContextManager[None]:
        """Loads that are set within begin at its end, all at once."""

    def search(self, rows: np.ndarray) -> None:
        """`Mechanics.search` of all rows."""

    def overlap(self, rows: np.ndarray) -> np.ndarray:
        """`Mechanics.overlap` of all rows."""

    def advance(self, rows: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Take steps; return steps taken [row] and whether diverged [row]."""

    def is_loading(self, rows: np.ndarray) -> np.ndarray:
        """[row] whether a load is being applied."""

    def check(self, rows: np.ndarray, checks: np.ndarray, loading: np.ndarray) -> Check:
        """`Mechanics.check` of all rows, at the checks [row] of their level."""

    def renew(self, rows: np.ndarray, checks: np.ndarray) -> None:
        """`Mechanics.renew` of all rows."""

    def stress(self, rows: np.ndarray) -> np.ndarray:
        """(row, 2, 2) [N/m]: `Mechanics.stress` of all rows."""


def advance(mechanics: Mechanics, steps: int) -> tuple[int, bool]:
    """Take steps with neighbour searches; return steps taken and whether the state diverged."""
    taken, state = 0, mechanics.state
    while taken < steps:
        before = int(state.steering.step)
        mechanics.step(steps - taken)
        now = state.steering.read()
        taken += int(now.step) - before
        if now.status == Steering.DIVERGED:
            return taken, True
        if now.status == Steering.STALE:
            mechanics.search()
    return taken, False


# cause of contacts that carry force as knitted
TOO_THICK = "the yarn is too thick for the loops, or the bars lap through each other"


def strength_exceeded(stress: float, strength: float) -> str:
    """Cause of non-convergence, after a comma: stress [Pa] above the strength; else empty."""
    return f", wire stress {engineering(stress, 'Pa')} exceeds the strength" if stress > strength else ""


class SingleMesh:
    """A group of one mesh."""

    keeps_equilibria = True

    def __init__(self, mechanics: Mechanics) -> None:
        self.model, self.members = mechanics.model, (mechanics,)
        self._mesh = mechanics

    def together(self) -> AbstractContextManager[None]:
        return nullcontext()

    def search(self, rows: np.ndarray) -> None:
        self._mesh.search()

    def overlap(self, rows: np.ndarray) -> np.ndarray:
        return np.zeros(len(rows))

    def advance(self, rows: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        taken, diverged = advance(self._mesh, steps)
        return np.array([taken]), np.array([diverged])

    def is_loading(self, rows: np.ndarray) -> np.ndarray:
        return np.array([self._mesh.state.steering.is_loading])

    def check(self, rows: np.ndarray, checks: np.ndarray, loading: np.ndarray) -> Check:
        check = self._mesh.check(int(checks[0]), loading=bool(loading[0]))
        return Check(np.array([check.residual]), np.array([check.ratio]))

    def renew(self, rows: np.ndarray, checks: np.ndarray) -> None:
        self._mesh.renew(int(checks[0]))

    def stress(self, rows: np.ndarray) -> np.ndarray:
        return self._mesh.stress()[None]
