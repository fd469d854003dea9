"""What a model offers to be loaded, stepped, judged and recorded: all that the engine knows of it.

A model is built once (`Model`), has a state that moves (`State`), and its mechanics steps that state (`Mechanics`). Many states
of one model that are stepped by one launch are a `Group`; one alone is a group, too (`Alone`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .kernels import control as c
from .measure import MeshModel
from .mesh.load_point import LoadPoint
from .mesh.rim import Rim


class Model(MeshModel, Protocol):
    """A mesh ready to run: everything that does not move."""

    @property
    def has_multilevel(self) -> bool:
        """Whether a large mesh starts from smaller ones, and is corrected as a membrane."""

    @property
    def has_replicas(self) -> bool:
        """Whether many of its states are stepped by one launch."""

    @property
    def loading_time(self) -> float:
        """[s] of a stage of a ramp."""


class State(Protocol):
    """Everything that moves."""

    @property
    def gradient(self) -> np.ndarray:
        """Deformation gradient (2, 2) of the boundary, a copy."""

    def read_control(self) -> np.ndarray:
        """The control array on the host (kernels/control.py)."""

    def write_control(self, values: dict[int, float]) -> None: ...
    def arrays(self) -> dict[str, np.ndarray]:
        """Host copies of all that a run needs to go on."""

    def restore(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `arrays` returned."""


@dataclass(frozen=True)
class Drift:
    """How long the tension must stand still in an equilibrium.

    What it moves over `checks` goes on to fall by the ratio seen from one such time to the next, at most `slowest_fall`; 0 takes
    what it moved for what is still to come.
    """

    checks: int
    slowest_fall: float = 0.0

    @property
    def needed(self) -> int:
        """Convergence checks before it can be judged."""
        return (2 if self.slowest_fall > 0.0 else 1) * self.checks


@dataclass(frozen=True)
class Check:
    """What a convergence check found; of many meshes, arrays [mesh]."""

    residual: Any  # out-of-balance force and motion, to be compared with solver.residual_tolerance; nan while a load comes on
    ratio: Any  # the largest of all criteria over what is allowed: below 1 all are met; inf while a load comes on


class Mechanics(Protocol):
    """Steps one mesh. Methods that take up a state leave it as it is but for what they say."""

    notes: list[str]  # what the user should know
    may_overlap: bool  # as knitted, before wires were pushed apart

    @property
    def drift(self) -> Drift:
        """How long the tension must stand still."""

    @property
    def can_overlap(self) -> bool:
        """Whether wires may pass through each other."""

    @property
    def model(self) -> Any: ...
    @property
    def state(self) -> Any: ...
    @property
    def rim(self) -> Rim | None:
        """The edge that is pulled or hangs on cords, where the mechanics moves it by itself."""

    @property
    def stations(self) -> np.ndarray:
        """(station, 2) [m] displacement of the edge from the affinely mapped outline; empty without a rim."""

    def compile(self) -> None:
        """Launch every kernel that a run needs, so that it is compiled; the state may change."""

    # --- loads

    def set_load(self, load: LoadPoint, steps: int, *, evenly: bool = False) -> None:
        """Have a load come on over so many steps, smoothly or `evenly`; with none it is there at once."""

    def load_steps(self, predicted: bool) -> int:
        """Steps over which the load of a level comes on, whether its state was predicted."""

    def predict(self, ratio: float) -> None:
        """Move the state by `ratio` of what the last level moved it, and remember this one; all motion stops."""

    def advance_history(self) -> None:
        """Take the equilibrium as a step of the load history: friction, yield."""

    @property
    def dissipated(self) -> float:
        """[J] taken out since the start by what depends on the load history."""

    # --- steps

    def search(self) -> None:
        """Search neighbours, and start a new travel budget."""

    def step(self, count: int) -> None:
        """Take steps; they do nothing once the state is frozen (kernels/control.py)."""

    def overlap(self) -> float:
        """Largest overlap of wires since this was last asked, over their thickness."""

    def fastest(self) -> tuple[int, int]:
        """The wire, and its node, that moves fastest."""

    # --- convergence of a relaxation

    def begin_level(self) -> None:
        """A load level begins: multipliers start anew."""

    def check(self, checks: int, *, loading: bool) -> Check:
        """Judge the state, and renew damping and multipliers; `checks` of the level so far, this one included."""

    def renew(self, checks: int) -> None:
        """Renew stiffnesses and masses that the load has outgrown."""

    def stress(self) -> np.ndarray:
        """(2, 2) [N/m] nominal stress of the mesh, with multipliers as they are now."""

    def causes(self) -> str:
        """What may keep the mesh from convergence, after a comma; empty where nothing is known."""

    def is_in_equilibrium(self, load: LoadPoint) -> bool:
        """Whether a mesh that was not stepped yet is in equilibrium under a load."""

    # --- real time

    def renew_time_step(self, steps: int) -> float:
        """Set and return the time step [s] that is stable for the next `steps` steps."""

    def reserve_for_load(self) -> None:
        """Search, and keep room for what a load that comes on will move."""

    def follow_load(self) -> None:
        """Search again before the motion of the load uses up the room kept for it."""

    def residual_now(self) -> float:
        """Out-of-balance force and motion of the state, to be compared with solver.residual_tolerance."""

    # --- observation

    def observe(self) -> Any:
        """The state on the host (measure/observables.py)."""

    def edge_work_terms(self, observed: Any) -> list[tuple[np.ndarray, np.ndarray]]:
        """Forces and what they move, of what differs from place to place: clamps beside the load, thermal strain."""

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays carried from check to check, beside the state."""

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `state_dict` returned."""


class Response(Protocol):
    """How endless cloth answers a change of its deformation gradient F about a load."""

    @property
    def tangent(self) -> np.ndarray:
        """(2, 2, 2, 2) [N/m] dP/dF, symmetric and positive; zero before the first load."""

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""


class Prolongation(Protocol):
    """Carries what changes on a smaller mesh over to a larger one of the same knit."""

    def carry(self, response: Any) -> None:
        """Add what changed on the smaller mesh since the last time; `response`: of the cloth at the load."""

    def state_dict(self) -> dict[str, np.ndarray]: ...
    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None: ...


class MembraneGrid(Protocol):
    """The coarse grid over a mesh, on which it is balanced as a membrane (solve/membrane.py)."""

    def gather(self) -> np.ndarray:
        """(grid node, 2) [N] out-of-balance forces, as the last convergence check found them."""

    def spread(self, displacement: np.ndarray, response: Any) -> None:
        """Move the mesh with the grid (grid node, 2) [m], its repeats as endless cloth answers; the clamps stay."""


# nominal stress (2, 2) [N/m] of one periodic repeat in equilibrium at a deformation gradient (2, 2) and a temperature [K], and
# what describes its state (`MultilevelMechanics.carried_values`)
CellState = Callable[[np.ndarray, float], tuple[np.ndarray, dict[str, np.ndarray]]]


class MultilevelMechanics(Mechanics, Protocol):
    """What a model offers besides, whose large meshes start from smaller ones and are corrected as membranes
    (solve/multilevel.py)."""

    def prolongation(self, smaller: Any) -> Prolongation:
        """What carries changes of a smaller mesh of the same knit, by its mechanics, over to this one."""

    def membrane_grid(self, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> MembraneGrid:
        """A grid of `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m]."""

    def carried_values(self) -> dict[str, np.ndarray]:
        """What tells two states of a mesh apart."""

    def find_response(self, cell_at: CellState, cell: Any, gradient: np.ndarray, temperature: float) -> Response:
        """How endless cloth answers at a load, by states of one repeat, the model `cell`. Raises `Diverged`."""

    def no_response(self, cell: Any) -> Response:
        """A cloth that does nothing."""

    def load_response(self, kept: dict[str, np.ndarray], cell: Any) -> Response:
        """The response whose `state_dict` is among what was kept."""

    def move_clamps(self, begin: np.ndarray, end: np.ndarray) -> None:
        """Have the next load take the clamps from displacements (clamp, 2) [m] to others."""

    def clamp_forces(self) -> np.ndarray:
        """(clamp, 2) [N] by which the wires pull at their clamps, as the last convergence check found them."""

    def renew_damping(self) -> None:
        """Set the damping by the motion of the last steps."""

    @property
    def checked_stress(self) -> np.ndarray:
        """(2, 2) [N/m] nominal stress, as the last convergence check found it."""

    def stop(self) -> None:
        """Stop all motion."""


class Group(Protocol):
    """Meshes of one model that are stepped and judged side by side, each for itself. `rows` are numbers of some of them."""

    @property
    def model(self) -> Any: ...
    @property
    def members(self) -> Sequence[Mechanics]: ...

    def advance(self, rows: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Take steps; steps taken [row] and which diverged [row]."""

    def is_loading(self, rows: np.ndarray) -> np.ndarray:
        """[row] whether a load still comes on."""

    def check(self, rows: np.ndarray, checks: np.ndarray, loading: np.ndarray) -> Check:
        """`Mechanics.check` of all rows, at the checks [row] of their level."""

    def renew(self, rows: np.ndarray, checks: np.ndarray) -> None:
        """`Mechanics.renew` of all rows."""

    def stress(self, rows: np.ndarray) -> np.ndarray:
        """(row, 2, 2) [N/m]: `Mechanics.stress` of all rows."""


def is_loading(state: State) -> bool:
    """Whether a load still comes on."""
    control = state.read_control()
    return bool(control[int(c.RAMP_STEP)] < control[int(c.RAMP_STEPS)])


def advance(mechanics: Mechanics, steps: int) -> tuple[int, bool]:
    """Take steps, searching neighbours whenever the last search no longer holds; steps taken, and whether the state diverged."""
    taken, state = 0, mechanics.state
    while taken < steps:
        before = int(state.read_control()[int(c.STEP)])
        mechanics.step(steps - taken)
        control = state.read_control()
        taken += int(control[int(c.STEP)]) - before
        status = control[int(c.STATUS)]
        if status == float(c.STATUS_DIVERGED):
            return taken, True
        if status == float(c.STATUS_STALE):
            mechanics.search()
    return taken, False


def beyond_strength(stress: float, strength: float) -> str:
    """A cause why a mesh does not converge, after a comma: its largest stress over the strength of the wire [Pa]."""
    return f", wires at {stress / 1e9:.3g} GPa are beyond their strength" if stress > strength else ""


class Alone:
    """A group of one mesh, of whatever model."""

    def __init__(self, mechanics: Mechanics) -> None:
        self.model, self.members = mechanics.model, (mechanics,)
        self._one = mechanics

    def advance(self, rows: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        taken, diverged = advance(self._one, steps)
        return np.array([taken]), np.array([diverged])

    def is_loading(self, rows: np.ndarray) -> np.ndarray:
        return np.array([is_loading(self._one.state)])

    def check(self, rows: np.ndarray, checks: np.ndarray, loading: np.ndarray) -> Check:
        found = self._one.check(int(checks[0]), loading=bool(loading[0]))
        return Check(np.array([found.residual]), np.array([found.ratio]))

    def renew(self, rows: np.ndarray, checks: np.ndarray) -> None:
        self._one.renew(int(checks[0]))

    def stress(self, rows: np.ndarray) -> np.ndarray:
        return self._one.stress()[None]
