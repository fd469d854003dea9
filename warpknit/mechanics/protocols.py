"""Protocols of a model, by which the engine loads, steps, checks and records it.

`Model` is constant, a state moves, `Mechanics` loads and observes one world. A `Group` steps and checks worlds, one or many
side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..base.text import engineering
from ..compute.kept import Owner
from ..measure import MeshModel
from ..mesh.rim import LoadPoint, Rim


class Model(MeshModel, Protocol):
    """A mesh ready to run: all constant data."""

    @property
    def table(self) -> Any:
        """Rest data of one repeat at its nodes; None for wires from a file."""

    @property
    def bodies(self) -> np.ndarray:
        """Index of each body [body] in the mesh of all ranks; `panel` is the strip of this rank."""

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
        """Limit of the time step, in words."""

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
    """Result of a convergence check."""

    residual: np.ndarray  # [row] out-of-balance force and motion, for solver.residual_tolerance; nan during loading
    ratio: np.ndarray  # [row] largest of all criteria over its tolerance: converged below 1; inf during loading


class Mechanics(Protocol):
    """One world of a group. Methods change only what they document."""

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
        """The group of this world."""

    @property
    def rows(self) -> np.ndarray:
        """[1] its index in the group."""

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
        """Apply a load over `steps` steps, smoothly or `evenly`; at once with 0 steps."""

    def load_steps(self, load: LoadPoint, predicted: bool) -> int:
        """Steps over which the load of a level is applied."""

    @property
    def release_parts(self) -> int:
        """Number of increments of the natural shape before the first record (`wire.set_fraction`, or a file's)."""

    def release(self, begin: float, end: float) -> None:
        """Apply the natural curvature and twist from one share to another: 0 as knitted, 1 as in the scene."""

    def predict(self, ratio: float) -> None:
        """Extrapolate the state by `ratio` times its last increment, and store it; set velocities to zero."""

    def rub(self, rubs: bool) -> None:
        """Whether wires rub from now on: not while they are at rest as knitted, to where they came by no motion of theirs."""

    def advance_history(self) -> None:
        """Update the history variables (friction, yield) from an equilibrium."""

    @property
    def has_load(self) -> bool:
        """Whether the whole load is applied: with a history, strains have a limit from one equilibrium to the next."""

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
        """Deepest overlap in words: wires, place, and a changed stiffness there."""

    def fastest(self) -> tuple[int, int]:
        """Wire and node of the largest speed."""

    # --- convergence of a relaxation

    def begin_level(self) -> None:
        """Start a load level: reset the multiplier rates."""

    def begin_test(self, *, is_certain: bool) -> None:
        """Test the stability of the next equilibrium: after a sufficient change of load, or if `is_certain`."""

    @property
    def has_left(self) -> bool:
        """Whether the mesh has left an unstable equilibrium of this level."""

    def stress(self) -> np.ndarray:
        """(2, 2) [N/m] nominal stress of the mesh."""

    def causes(self) -> str:
        """Likely causes of non-convergence, after a comma; may be empty."""

    def is_in_equilibrium(self, load: LoadPoint) -> bool:
        """Whether the mesh as knitted is in equilibrium under a load."""

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
        """Prolongation to this mesh from the mechanics of a smaller one.

        Its `carry(response)` adds the changes of the smaller mesh since the last call; `response`: of the cloth at the load. It
        returns False where the larger mesh cannot take them, which `put_back()` undoes. `replaces`: its state takes the place of
        the larger mesh's; else the change of one repeat is added.
        """

    def membrane_grid(self, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> Any:
        """Grid that balances the mesh as a membrane: `cells` (2,) from `low` (2,) [m], each of size `cell` (2,) [m].

        `max_strain` is the largest strain of one correction, `least_lift` [m] the smallest useful displacement out of the plane.
        `gather()` returns the out-of-balance forces (grid node, 2) [N] of the last convergence check, `gather_across()` the
        forces out of the plane [grid node] [N], None in a planar model. `spread(displacement, response)` moves the mesh with the
        grid (grid node, 2) [m], its repeats by the response, `spread_across(displacement)` out of its plane [grid node] [m]; the
        clamps stay.
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
        """Set displacements (clamp, 2) [m] of clamps at start and end of the next load."""

    def move_stations(self, change: np.ndarray) -> None:
        """Move stations of a rim of the mechanics by (station, 3) [m], and the clamps with them."""

    def clamp_forces(self) -> np.ndarray:
        """Forces (clamp, n) [N] of the wires at their clamps, from the last convergence check; n = 2 or 3."""

    def renew_damping(self) -> None:
        """Set the damping by the motion of the last steps."""


# cause of contacts that carry force as knitted
TOO_THICK = "the yarn is too thick for the loops, or the bars lap through each other"


def strength_exceeded(stress: float, strength: float) -> str:
    """Cause of non-convergence, after a comma: stress [Pa] above the strength; else empty."""
    return f", wire stress {engineering(stress, 'Pa')} exceeds the strength" if stress > strength else ""
