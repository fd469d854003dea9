"""Work of the load of a relaxation, over the rows of history.csv.

    W = integral of A0 P : dF + (thermal force) d(length factor),      the work of a quasi-static load.

Along one branch of equilibria forces and displacements are monotone cubics (PCHIP) through the states: where both are monotone
between two states, so are the curves, and their work lies within the bounds of measure/jumps.py. Between two branches the states
tell nothing of the way, and the work is that of the mean force. Energy lost there shows as a difference from the stored energy.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from ..measure import MeshModel
from ..results.row import Row
from .branches import jumps_of
from .history import stages_of, work_terms

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(3)  # exact for the fifth degree: a cubic force times the slope of a cubic


def with_work(rows: Sequence[Row], model: MeshModel) -> list[Row]:
    """The rows of a relaxation with their work, along each branch of equilibria and from one to the next."""
    if model.scene.solver.drive != "relax" or not rows:
        return list(rows)
    behind = {id(after) for _, after in jumps_of(model, rows)}
    done = [rows[0].changed(work_J=rows[0].stored)]
    for part in stages_of(rows):
        force, place = work_terms(part, model.panel.area)
        jumps = np.array([id(row) in behind for row in part[1:]])
        for after, step in zip(part[1:], work_steps(force, place, jumps).tolist(), strict=True):
            done.append(after.changed(work_J=done[-1].work_J + step + after.edge_work_J - done[-1].edge_work_J))
    return done


def work_steps(force: NDArray[np.float64], place: NDArray[np.float64], jumps: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(state - 1,) [J] work from each state to the next.

    force (state, component), place (state, component): their products are energies [J]. jumps: (state - 1,) whether a state and
    the next are of different branches.
    """
    work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(place, axis=0), axis=1)
    ends = [0, *(np.flatnonzero(jumps) + 1).tolist(), len(force)]
    for begin, end in zip(ends, ends[1:], strict=False):
        if end - begin > 2:
            work[begin : end - 1] = _along_branch(force[begin:end], place[begin:end])
    return work


def _along_branch(force: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """(state - 1,) [J] work between neighbouring states of one branch."""
    path = np.arange(len(force), dtype=float)
    inside = path[:-1, None] + 0.5 * (1.0 + POINTS)
    power = np.sum(PchipInterpolator(path, force)(inside) * PchipInterpolator(path, place).derivative()(inside), axis=2)
    return np.asarray(power @ (0.5 * WEIGHTS))
