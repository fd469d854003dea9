"""Coarse-grid correction of large meshes: long-wave out-of-balance forces are balanced on a membrane grid.

Short-wave errors decay in some hundred steps, long-wave errors in a number of steps that grows with the square of the mesh size.
Out-of-balance forces are therefore gathered at intervals onto a grid of bilinear membrane elements
(kernels/membrane_transfer.py). They have the stiffness of endless cloth at the load: the derivative of the nominal stress of one
periodic repeat in equilibrium. The displacement that balances the forces is applied to the mesh; its stress measures the
imbalance.

Long waves out of the plane carry little force: a mesh that is far from its height may be within the tolerance of its residual.
They are balanced in the same way, by `Lift`, whose correction measures the error of the height.

Grid nodes of cells that the outline cuts follow the nearest place of the outline (rim.py). They are fixed where the edge is
held; on a cord the stations of the cord are unknowns like the grid nodes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from ..mechanics.protocols import Mechanics
from ..mechanics.response import Response
from ..mesh.rim import REPEATS_A_CELL, Rim, build_rim

MAX_CELLS = 96  # cells of the grid in one direction
BALANCE_CHECKS = 2  # convergence checks between two looks at the balance, at least
CORRECTION_STEPS = 150  # steps between corrections, which disturb loops, at least
# short waves have decayed where the residual over its tolerance is below the first, or its share left by a check above the second
SETTLED, SLOW_DECAY = 1.5, 0.8
LIFT_TOLERANCE = 0.005  # of the height of the edge above the apex: error of the height of the mesh
LEAST_LIFT = 0.1  # the same, of the thickness of the wire, at least
LEAST_SAG = 1e-4  # the same, of the sag of a cord
MAX_SLOPE = 0.05  # of one correction, which tilts loops rigidly
# of a correction: the mesh inside has less tension than its mean, where cut wires at the grips carry more
LARGEST_FACTOR = 2.0
FACTORS = (0.1, 1.0)  # of a correction, smallest, and largest by default
CORD_STEPS, CORD_ERROR = 8, 1e-3  # Newton steps of a cord in a correction, and their error


def is_settled(residual: float, before: float) -> bool:
    """Whether short waves have decayed; from the residuals over their tolerance at this and the last check."""
    return residual > SLOW_DECAY * before or residual < SETTLED


class EdgeState(NamedTuple):
    """The edge of a mesh, and the forces on it."""

    gradient: np.ndarray  # (2, 2)
    stations: np.ndarray  # (station, n) [m]; n = 2, or 3 in the spatial model
    held: np.ndarray  # (clamp, n) [N] forces of the wires of this rank


@dataclass(frozen=True)
class Correction:
    """A displacement of the mesh as a membrane."""

    grid: np.ndarray  # (grid node, 2) [m], or (grid node, 1) out of the plane
    stations: np.ndarray  # (station, 2) [m] of the rim, or (station, 1)
    max_factor: float = 1.0  # largest share to apply at once

    def scaled(self, share: float) -> Correction:
        return Correction(share * self.grid, share * self.stations, min(1.0, self.max_factor / share))

    @property
    def in_space(self) -> np.ndarray:
        """(station, 3) [m] of the rim."""
        before = 2 if self.stations.shape[1] == 1 else 0
        return np.pad(self.stations, [(0, 0), (before, 3 - before - self.stations.shape[1])])

    @property
    def vector(self) -> np.ndarray:
        """All displacements in one array [m]."""
        return np.concatenate([self.grid.ravel(), self.stations.ravel()])


def _with_cord(stiffness: sparse.csr_matrix, cord: sparse.csr_matrix) -> sparse.csr_matrix:
    """Stiffness of grid nodes, then stations, with the cord's between stations [N/m]."""
    there, first = cord.tocoo(), stiffness.shape[0] - cord.shape[0]
    placed = (there.data, (there.row + first, there.col + first))
    return stiffness + sparse.csr_matrix(placed, shape=stiffness.shape)


def _factors(matrix: sparse.csr_matrix, free: np.ndarray) -> SuperLU:
    """Factors of the rows and columns `free` of a symmetric matrix: in an order for such, with half the entries or less."""
    return splu(matrix[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


class Aitken:
    """Aitken's relaxation factor of one kind of correction.

    Full corrections overshoot where the assumed stiffness is too small. The next factor follows from the last correction d0,
    applied with the factor w, and the new correction d1:  w -> -w d0 . (d1 - d0)/|d1 - d0|^2
    """

    KEPT = ("factor", "_last")

    def __init__(self, largest: float = FACTORS[1]) -> None:
        self._factors = FACTORS[0], largest
        self.factor = 1.0  # of the last correction
        self._last = np.zeros(0)

    def begin(self) -> None:
        """Forget earlier corrections."""
        self.factor, self._last = 1.0, np.zeros(0)

    def next_factor(self, correction: np.ndarray, max_factor: float) -> float:
        """Factor to apply to a correction [any], at most `max_factor`."""
        last, self._last, share = self._last, correction, 1.0
        if len(last) == len(correction):
            change = correction - last
            share = -self.factor * float(last @ change) / max(float(change @ change), 1e-300)
            # an error that has grown in the direction of the last correction was not caused by it
            share = float(np.clip(share, *self._factors)) if share > 0.0 else 1.0
        self.factor = max_factor * share
        return self.factor


class Membrane:
    """The coarse grid over a gripped mesh."""

    def __init__(self, mechanics: Mechanics, rim: Rim, cell: float | None = None) -> None:
        """cell: size of its cells [m]; default: REPEATS_A_CELL repeats."""
        self.model, self.rim = mechanics.model, rim
        self.tangent = np.zeros((2, 2, 2, 2))
        size = np.array(self.model.panel.size)
        cells = np.array(self.model.scene.knit.repeats) // REPEATS_A_CELL if cell is None else np.rint(size / cell).astype(int)
        self._cells = np.clip(cells, 1, MAX_CELLS)
        self._cell = size / self._cells
        self.grid = mechanics.membrane_grid(self.model.panel.low, self._cell, self._cells)
        self._filled = self._filled_share()
        # of the cloth [N m]: straight wires in all directions
        wires = float(self.model.global_model.panel.wire_length.sum()) / self.model.panel.area
        self._bending_stiffness = 0.375 * self.model.bending_stiffness * wires
        self._clamps = build_rim(self.model.global_model.panel, self.model.scene).clamps  # of all ranks
        self._tie_grid()

    def _filled_share(self) -> np.ndarray:
        """(cells x, cells y) share of each cell that lies inside the outline."""
        nx, ny = self._cells
        outline = self.rim.outline
        if len(outline.corners) == 4 and np.isclose(outline.area, np.prod(self.model.panel.size)):
            return np.ones((nx, ny))
        return outline.cover(self.model.panel.low, self._cell, (int(nx), int(ny)))

    def _tie_grid(self) -> None:
        """Build `_tied` (2 grid node, unknown + 2 station), and `_tied_across` with half of both: the grid as a function of free
        nodes and stations.
        """
        nx, ny = self._cells
        is_inside = np.zeros((nx + 2, ny + 2), dtype=bool)
        is_inside[1:-1, 1:-1] = self._filled > 1.0 - 1e-9
        free = (is_inside[:-1, :-1] & is_inside[1:, :-1] & is_inside[:-1, 1:] & is_inside[1:, 1:]).ravel()
        ix, iy = (a.ravel() for a in np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), indexing="ij"))
        place = self.model.panel.low + self._cell * np.stack([ix, iy], axis=1)
        arc, _ = self.rim.outline.nearest(place[~free])
        identity = sparse.identity(len(free), format="csc")
        both = sparse.hstack([identity[:, free], identity[:, ~free] @ self.rim.weights(arc)]).tocsr()
        self._tied_across = both
        self._tied = sparse.kron(both, sparse.identity(2)).tocsr()
        moves = np.concatenate([np.ones(free.sum(), dtype=bool), ~self.rim.given])
        self._free_across = np.flatnonzero(moves)
        self._free = np.flatnonzero(np.repeat(moves, 2))

    def renew(self, response: Response) -> None:
        """Assemble the stiffness from the response of the cloth."""
        self.tangent = tangent = response.tangent
        self._response = response
        if not tangent.any():  # before the first load
            return
        self._stiffness = (self._tied.T @ self._assembled(tangent) @ self._tied).tocsr()
        self._solve = None if self.rim.is_free else _factors(self._stiffness, self._free).solve

    def _assembled(self, tangent: np.ndarray) -> sparse.csr_matrix:
        """(2 grid node, 2 grid node) [N/m] stiffness of all cells, by a tangent (2, 2, 2, 2) [N/m]."""
        nx, ny = self._cells
        corner = np.array([[i % 2, i // 2] for i in range(4)])
        points = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
        element = np.zeros((4, 2, 4, 2))
        for s in points:
            for t in points:
                wx, wy = np.where(corner[:, 0], s, 1 - s), np.where(corner[:, 1], t, 1 - t)
                slope = (2 * corner - 1) * np.stack([wy, wx], axis=1) / self._cell
                element += np.einsum("ib,abcd,jd->iajc", slope, tangent, slope) * 0.25 * np.prod(self._cell)
        ix, iy = (a.ravel() for a in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"))
        node = (ix[:, None] + corner[:, 0]) * (ny + 1) + iy[:, None] + corner[:, 1]
        number = (2 * node[:, :, None] + np.arange(2)).reshape(len(node), 8)
        rows, columns = np.repeat(number, 8, axis=1), np.tile(number, (1, 8))
        values = self._filled.ravel()[:, None] * element.reshape(64)
        return sparse.coo_matrix((values.ravel(), (rows.ravel(), columns.ravel()))).tocsr()

    def imbalance(self) -> np.ndarray:
        """Out-of-balance forces (grid node, 2) [N], as the last convergence check found them."""
        self._unbalanced = self.grid.gather()
        return self._unbalanced

    def warm_up(self, response: Response) -> None:
        """Compile every kernel by launching it; the mesh does not move."""
        self._response = response
        self.imbalance()
        self.move(Correction(np.zeros((int(np.prod(self._cells + 1)), 2)), np.zeros((len(self.rim.arc), 2))))

    def solve(self, edge: EdgeState, share: float = 1.0) -> tuple[Correction, float]:
        """Correction that balances a share of the forces; its rms stress [N/m]."""
        force = self._tied.T @ self._unbalanced.reshape(-1)
        if self.rim.is_free:
            pull = self._pull(edge)[:, :2]
            force[-pull.size :] += pull.ravel()
        return self._correction(share * force, np.zeros(len(force)), edge)

    def edge_error(self, correction: Correction, edge: EdgeState) -> float:
        """Largest motion of a station by a correction, over the sag of the cords.

        The force of a stiff cord may be far out of balance although its stations are in place.
        """
        stations = edge.stations[:, :2]
        sag = np.abs(stations + correction.stations - self.rim.chords @ stations[self.rim.given]).max()
        return float(np.abs(correction.stations).max() / max(float(sag), LEAST_SAG * self.model.scene.wire.thickness))

    def solve_rim(self, edge: EdgeState) -> tuple[Correction, float]:
        """Solve for the edge alone, with the mesh behind it fixed."""
        pull = self._pull(edge)[:, :2]
        force = np.zeros(self._tied.shape[1])
        force[-pull.size :] = pull.ravel()
        free = self._free[self._free >= len(force) - pull.size]
        moved = self._balance(force, np.zeros(len(force)), edge, free)[-pull.size :].reshape(-1, 2)
        excess = float(np.abs(moved).max()) / (self.grid.max_strain * float(self._cell.min()))
        return Correction(np.zeros((self._tied.shape[0] // 2, 2)), moved, 1.0 / max(1.0, excess)), 0.0

    def _pull(self, edge: EdgeState) -> np.ndarray:
        """Forces (station, n) [N] of the wires on all ranks, and of the cord."""
        of_mesh = np.concatenate(self.model.ranks.everyone(edge.held))
        return np.asarray(self._clamps.T @ of_mesh + self.rim.cord_forces(edge.gradient, edge.stations)[0])

    def follow(self, given: np.ndarray, edge: EdgeState) -> Correction:
        """Displacement of the mesh as a membrane when held stations move by `given` (station, 2) [m]."""
        known = np.zeros(self._tied.shape[1])
        known[-given.size :] = np.where(self.rim.given[:, None], given, 0.0).ravel()
        return self._correction(np.zeros(len(known)), known, edge)[0]

    def _correction(self, force: np.ndarray, known: np.ndarray, edge: EdgeState) -> tuple[Correction, float]:
        """The displacement under forces [N] with the `known` displacements, and its stress [N/m]."""
        solution = self._balance(force, known, edge, self._free)
        grid = self._tied @ solution
        slope = self._gradient(grid)
        stress = np.einsum("abcd,xycd->xyab", self.tangent, slope)
        square = np.sum(stress**2, axis=(2, 3))
        out_of_balance = float(np.sqrt(np.average(square, weights=self._filled)))
        max_factor = min(1.0, self.grid.max_strain / max(float(np.abs(slope).max()), 1e-30))
        moved = solution[len(solution) - 2 * len(self.rim.arc) :].reshape(-1, 2)
        return Correction(grid.reshape(-1, 2), moved, max_factor), out_of_balance

    def _balance(self, force: np.ndarray, known: np.ndarray, state: EdgeState, free: np.ndarray) -> np.ndarray:
        """Displacements, `known` or `free`, that balance forces [N]; a cord turns as it moves."""
        solution = known.copy()
        if self._solve is not None:
            solution[free] = self._solve((force - self._stiffness @ known)[free])
            return solution
        gradient, stations = state.gradient, state.stations[:, :2]
        edge = slice(len(solution) - stations.size, None)
        begin = self.rim.cord_forces(gradient, stations)[0]
        for _ in range(CORD_STEPS):
            there = stations + solution[edge].reshape(-1, 2)
            unbalanced = force - self._stiffness @ solution
            unbalanced[edge] += (self.rim.cord_forces(gradient, there)[0] - begin).ravel()
            matrix = _with_cord(self._stiffness, self.rim.cord_stiffness(gradient, there))
            step = _factors(matrix, free).solve(unbalanced[free])
            solution[free] += step
            if np.abs(step).max() <= CORD_ERROR * np.abs(solution).max():
                break
        return solution

    def _gradient(self, moved: np.ndarray) -> np.ndarray:
        """Displacement gradient (cells x, cells y, 2, 2) at the cell centres, from (2 grid node,) [m]."""
        moved = moved.reshape(*(self._cells + 1), 2)
        along_x, along_y = np.diff(moved, axis=0) / self._cell[0], np.diff(moved, axis=1) / self._cell[1]
        return np.stack([0.5 * (along_x[:, 1:] + along_x[:, :-1]), 0.5 * (along_y[1:] + along_y[:-1])], axis=-1)

    def solve_across(self, edge: EdgeState, stress: np.ndarray, max_slope: float | None = None) -> Correction | None:
        """Correction out of the plane, (grid node, 1) and (station, 1), of a spatial mesh under tension; None without tension.

        stress (2, 2) [N/m] nominal. max_slope: largest of one correction; default: the largest strain of the grid. The tension
        S = F^-1 P resists: div(S grad w) + R = 0.
        """
        force, tension = self.grid.gather_across(), np.linalg.solve(edge.gradient, stress)
        tension = 0.5 * (tension + tension.T)
        if force is None or not len(self._free_across) or np.linalg.eigvalsh(tension).min() <= 0.0:
            return None
        # two uncoupled displacements; one is used
        tied, free = self._tied_across, self._free_across
        pulled, laplacian = (
            (tied.T @ self._assembled(np.einsum("ac,bd->abcd", np.eye(2), part))[::2, ::2] @ tied).tocsr()
            for part in (tension, np.eye(2))
        )
        force = tied.T @ force
        if self.rim.is_free:
            force[-len(edge.stations) :] += self._pull(edge)[:, 2]
            pulled = _with_cord(pulled, self.rim.cord_stiffness(edge.gradient, edge.stations)[2::3, 2::3])
        matrix = pulled + self._bending_stiffness / float(np.prod(self._cell)) * (laplacian @ laplacian)
        solution = np.zeros(tied.shape[1])
        solution[free] = _factors(matrix, free).solve(force[free])
        displacement = tied @ solution
        slope = self._gradient(np.repeat(displacement, 2))
        share = min(1.0, (max_slope or self.grid.max_strain) / max(float(np.abs(slope).max()), 1e-30))
        return Correction(displacement[:, None], solution[tied.shape[1] - len(self.rim.arc) :, None], share)

    def move(self, correction: Correction) -> None:
        """Move the mesh with the grid, and clamps on a rim of the mechanics."""
        self.grid.spread(correction.grid, self._response, correction.in_space)


class Lift:
    """The error of the height of a mesh over its tolerance, and its correction."""

    KEPT = ("imbalance", "_next_look", "_next_correction", "_residual", "_aitken")

    def __init__(self, mechanics: Mechanics, rim: Rim) -> None:
        self.mechanics = mechanics
        scene = mechanics.model.scene
        self.membrane = Membrane(mechanics, rim, scene.knit.wale_spacing)
        self._tolerance, self._least = scene.solver.residual_tolerance, LEAST_LIFT * scene.wire.thickness
        self._aitken = Aitken(LARGEST_FACTOR)
        self.begin()

    def warm_up(self) -> None:
        """Compile its kernels by launching them."""
        self.membrane.grid.spread_across(np.zeros(len(self.membrane.imbalance())))

    def begin(self) -> None:
        """Begin a load level."""
        self.imbalance = self._residual = math.inf
        self._next_look, self._next_correction = BALANCE_CHECKS, 0
        self._aitken.begin()

    def correct(self, check: int, residual: float) -> bool:
        """Measure the error of the height and lift the mesh by it, where due; return whether it moved.

        By the number and the residual of a check. `imbalance` is that error over its tolerance."""
        residual /= self._tolerance
        is_due = check >= self._next_look and is_settled(residual, self._residual)
        self._residual = residual
        if is_due:
            self._next_look = check + BALANCE_CHECKS
        return is_due and self._correct(check)

    def _correct(self, check: int) -> bool:
        mechanics, membrane = self.mechanics, self.membrane
        membrane.imbalance()
        edge = EdgeState(mechanics.state.gradient, mechanics.stations, mechanics.clamp_forces())
        lift = membrane.solve_across(edge, mechanics.checked_stress, MAX_SLOPE)
        if lift is None:  # a slack mesh has no height of its own
            self.imbalance = 0.0
            return False
        tolerance = max(LIFT_TOLERANCE * float(np.abs(mechanics.stations[:, 2]).max()), self._least)
        height = max(1.0, self._aitken.factor) * float(np.abs(lift.grid).max()) / tolerance
        self.imbalance = height
        if height <= 1.0 or check < self._next_correction:
            return False
        self._next_correction = check + CORRECTION_STEPS // mechanics.check_steps
        lift = lift.scaled(self._aitken.next_factor(lift.vector, lift.max_factor))
        membrane.grid.spread_across(lift.grid[:, 0], lift.in_space)
        return True
