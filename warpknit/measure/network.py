"""Sheet resistance of a mesh: its wires and contacts as a network of resistors.

A stretch of wire between two touching places is a resistor, a place where wires touch (measure/observables.py) another: the
constriction of the current at one round spot between two wires whose surface yields (Holm, Electric Contacts, 1967),

    R = (rho / 2) sqrt(pi H / F),      rho resistivity, H hardness, F force of the contact.

One repeat stands for endless cloth. With a mean field e the potential at x is e . x + phi, phi the same in every repeat; phi
follows from Kirchhoff's law, the mean current per width from the currents in all resistors.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ..scene import Wire
from ..scene.materials import MATERIALS, Material
from .observables import ContactPlaces, Observables

SHORTEST = 1e-9  # of a wire: length between two contacts at the same place
CONDUCTS = 1e-9  # of the better direction: a worse conductance is round-off


def sheet_conductance(ends: np.ndarray, reach: np.ndarray, conductance: np.ndarray, count: int, area: float) -> np.ndarray:
    """Mean current per width over mean field (2, 2) [S] of an endless periodic network.

    ends: (resistor, 2) points of each, `count` in a repeat. reach: (resistor, 2) [m] from its first end to its second, which may
    lie in another repeat. conductance: [resistor] [S]. area: [m2] of a repeat.
    """
    m = len(ends)
    if m == 0:
        return np.zeros((2, 2))
    rows = np.tile(np.arange(m), 2)
    signs = np.repeat([-1.0, 1.0], m)
    drop = sparse.coo_matrix((signs, (rows, ends.T.ravel())), shape=(m, count)).tocsr()  # a resistor to itself: zero
    weighted = sparse.diags(conductance) @ drop
    _, piece = connected_components(sparse.coo_matrix((np.ones(m), (ends[:, 0], ends[:, 1])), shape=(count, count)))
    free = np.setdiff1d(np.arange(count), np.unique(piece, return_index=True)[1])  # of each piece one point is at zero
    potential = np.zeros((count, 2))
    if len(free):
        matrix = (drop[:, free].T @ weighted[:, free]).tocsc()
        potential[free] = splu(matrix).solve(-(weighted[:, free].T @ reach))
    return np.asarray(reach.T @ (conductance[:, None] * (drop @ potential + reach)) / area)


def surface(wire: Wire) -> Material:
    """Metal at the surface of the wire, with the scene's hardness."""
    metal = MATERIALS[wire.plating.material if wire.plating is not None else wire.material]
    return replace(metal, hardness=wire.hardness)


def holm_resistance(metal: Material, force: np.ndarray | float) -> np.ndarray:
    """[Ohm] resistance of contacts with `force` [N]."""
    return np.asarray(0.5 * metal.resistivity * np.sqrt(math.pi * metal.hardness / np.asarray(force)))


def wire_resistance(wire: Wire) -> float:
    """[Ohm/m] resistance of the yarn: its ends and their platings in parallel."""
    core = math.pi * wire.radius**2 / MATERIALS[wire.material].resistivity
    coat = 0.0
    if wire.plating is not None:
        outer = wire.radius + wire.plating.thickness
        coat = math.pi * (outer**2 - wire.radius**2) / MATERIALS[wire.plating.material].resistivity
    return 1.0 / (wire.ends * (core + coat))


def contact_resistances(r: Observables) -> np.ndarray:
    """[Ohm] resistance of each contact (measure/observables.py)."""
    return holm_resistance(surface(r.model.scene.wire), r.contact_places.force)


def sheet_resistance(r: Observables) -> tuple[float | None, float | None]:
    """Sheet resistance in weft and warp [Ohm] of a periodic mesh, without a transverse field; None without conduction."""
    area = r.model.panel.area * float(np.linalg.det(r.gradient))
    ends, reach, conductance, count = _network(r.contact_places, r.model.scene.wire)
    conducted = np.diag(sheet_conductance(ends, reach @ r.gradient.T, conductance, count, area))
    least = CONDUCTS * conducted.max()
    weft, warp = (1.0 / g if g > least else None for g in conducted.tolist())
    return weft, warp


def _network(t: ContactPlaces, wire: Wire) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Ends, reach as knitted, conductance and number of points, for `sheet_conductance`.

    There are two points at each contact, and one on each wire without contacts.
    """
    per_length = wire_resistance(wire)
    count = 2 * len(t.force)
    ends, reach = [np.arange(count).reshape(-1, 2)], [t.reach]
    conductance = [1.0 / holm_resistance(surface(wire), t.force)]
    for number, (length, period) in enumerate(zip(t.wire_length, t.wire_period, strict=True)):
        points = np.flatnonzero(t.wire.ravel() == number)
        arc = t.arc.ravel()[points]
        order = np.argsort(arc)
        points, arc, place = points[order], arc[order], t.rest.reshape(-1, 2)[points[order]]
        if not len(points):
            points, arc, place, count = np.array([count]), np.zeros(1), np.zeros((1, 2)), count + 1
        ends.append(np.stack([points, np.roll(points, -1)], axis=1))
        reach.append(np.diff(np.concatenate([place, place[:1] + period]), axis=0))
        stretches = np.diff(np.append(arc, arc[0] + length))
        conductance.append(1.0 / (per_length * np.maximum(stretches, SHORTEST * length)))
    return np.concatenate(ends), np.concatenate(reach), np.concatenate(conductance), count
