"""Grids of straight wires for the field solver, and closed forms of what they reflect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from warpknit.reflection.currents import MeshCurrents, ThinWires
from warpknit.reflection.waves import DOWN, LIGHT, UP, Z0, Angles, Scattering, mode_decay, polarisations

NO_SHIFT = (0, 0)


def solve(
    mesh: MeshCurrents, frequency: float, angles: Angles, wire: complex, contacts: Sequence[np.ndarray]
) -> list[Scattering]:
    """Waves from the mesh at one frequency [Hz]; wire and contacts as in `MeshCurrents.scattering`."""
    k = 2.0 * np.pi * frequency / LIGHT
    return mesh.scattering(k, angles, mesh.stored(k, angles), wire, contacts)


def sheet_impedance(waves: Scattering) -> np.ndarray:
    """(2, 2) [Ohm] over the directions of TE and TM: of a thin sheet that reflects the same at normal incidence."""
    tangential = waves.reflection * np.array([[1.0], [-1.0]])  # the field of a reflected TM wave turns over
    return np.asarray(-0.5 * Z0 * (np.eye(2) + np.linalg.inv(tangential)))


def ring(count: int, first: int, shift: tuple[int, int]) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Branches and shifts of a wire of `count` nodes from `first` on that goes on in the next repeat."""
    branches = [(first + i, first + (i + 1) % count) for i in range(count)]
    return branches, [shift if i == count - 1 else NO_SHIFT for i in range(count)]


def straight(start: tuple[float, float, float], along: tuple[float, float], count: int) -> np.ndarray:
    """(count, 3) [m] nodes of a straight wire."""
    share = np.arange(count)[:, None] / count
    return np.array(start) + share * np.array([*along, 0.0])


def parallel_wires(spacing: float, radius: float, count: int, cut: bool = False) -> ThinWires:
    """Wires along x in a square cell; cut: with a contact of no length in each period."""
    cell = np.eye(2) * spacing
    if not cut:
        branches, shifts = ring(count, 0, (1, 0))
        return ThinWires(cell, radius, straight((0.0, 0.0, 0.0), (spacing, 0.0), count), np.array(branches), np.array(shifts))
    node = np.concatenate([straight((0.0, 0.0, 0.0), (spacing, 0.0), count), [[spacing, 0.0, 0.0]]])
    branches = [(i, i + 1) for i in range(count)]
    return ThinWires(
        cell, radius, node, np.array(branches), np.zeros((count, 2), int), np.array([[count, 0]]), np.array([[1, 0]])
    )


def bonded_grid(spacing: float, radius: float, count: int) -> ThinWires:
    """Wires along x and y that join where they cross, in one plane."""
    x, shift_x = ring(count, 0, (1, 0))
    y, shift_y = ring(count, count - 1, (0, 1))
    y = [tuple(0 if node == count - 1 else node for node in branch) for branch in y]
    along_x, along_y = (straight((0.0, 0.0, 0.0), along, count) for along in ((spacing, 0.0), (0.0, spacing)))
    node = np.concatenate([along_x, along_y[1:]])
    return ThinWires(np.eye(2) * spacing, radius, node, np.array(x + y), np.array(shift_x + shift_y))


def stacked_grid(spacing: float, radius: float, count: int, cell: np.ndarray | None = None) -> ThinWires:
    """Wires along x, and along y two radii above, with a contact at the crossing; cell: other periods of the same lattice."""
    x, shift_x = ring(count, 0, (1, 0))
    y, shift_y = ring(count, count, (0, 1))
    along_x = straight((0.0, 0.0, 0.0), (spacing, 0.0), count)
    along_y = straight((0.0, 0.0, 2.0 * radius), (0.0, spacing), count)
    shift = np.array(shift_x + shift_y)
    if cell is not None:
        shift = np.rint(spacing * shift @ np.linalg.inv(cell)).astype(int)
    cell = np.eye(2) * spacing if cell is None else cell
    contact = np.array([[0, count]]), np.zeros((1, 2), int)
    return ThinWires(cell, radius, np.concatenate([along_x, along_y]), np.array(x + y), shift, *contact)


def repeated(wires: ThinWires, count: int) -> ThinWires:
    """`count` repeats along the first period as one."""
    size = len(wires.node)

    def copies(node: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nodes, shifts = [], []
        for copy in range(count):
            to = copy + shift[:, 0]
            nodes.append(np.stack([node[:, 0] + copy * size, node[:, 1] + to % count * size], axis=1))
            shifts.append(np.stack([to // count, shift[:, 1]], axis=1))
        return np.concatenate(nodes), np.concatenate(shifts)

    node = np.concatenate([wires.node + [*(copy * wires.cell[0]), 0.0] for copy in range(count)])
    cell = wires.cell * np.array([[count], [1]])
    branches, contacts = (
        copies(wires.branch_node, wires.branch_shift), copies(wires.contact_node, wires.contact_shift)
    )  # fmt: skip
    return ThinWires(cell, wires.radius, node, *branches, *contacts)


def wavy_wire(spacing: float, radius: float, count: int = 24) -> ThinWires:
    """A wire without symmetry in a skew cell."""
    share = np.arange(count) / count
    turn = 2.0 * np.pi * share
    offset = 0.01 * np.random.default_rng(1).normal(size=(count, 3))
    node = spacing * (np.stack([share, 0.2 * np.sin(turn + 1.0), 0.1 * np.cos(2.0 * turn)], axis=1) + 0.1 * offset)
    branches, shifts = ring(count, 0, (1, 0))
    return ThinWires(spacing * np.array([[1.0, 0.0], [0.3, 0.8]]), radius, node, np.array(branches), np.array(shifts))


def parallel_reflection(k: float, kt: np.ndarray, spacing: float, radius: float, wire: complex = 0.0) -> np.ndarray:
    """(2, 2) reflection of wires along x with `wire` [Ohm/m], from the closed sum over modes (MacFarlane 1946, Wait 1955):

        Z I = p_x,    Z = z d + j k Z0 (1 - kx^2/k^2) sum over modes of exp(-u a)/(2 u)

    Waves leave from the axis, so of a mode that travels the term is 1/u - a.
    """
    n = np.arange(-20000, 20001)
    u = mode_decay(k, np.stack([0 * n + kt[0], kt[1] + 2.0 * np.pi * n / spacing], axis=1))
    total = np.where(u.real == 0.0, 1.0 / u - radius, np.exp(-u * radius) / u).sum()
    impedance = wire * spacing + 0.5j * k * Z0 * (1.0 - kt[0] ** 2 / k**2) * total
    phi = float(np.arctan2(kt[1], kt[0]))
    up, down = polarisations(k, kt, UP, phi), polarisations(k, kt, DOWN, phi)
    return -k * Z0 / (2.0 * np.sqrt(k**2 - kt @ kt)) * np.outer(up[:, 0], down[:, 0]) / impedance
