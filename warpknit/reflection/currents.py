"""Currents driven by a plane wave in a periodic mesh, and scattered waves.

Mixed-potential integral equation of thin wires (Harrington, Field Computation by Moment Methods, 1968) in the circuit form of
Ruehli (IEEE Trans. MTT 22 (1974) 216):

    current I       one for each branch, at its middle, and one for each contact
    charge Q        one for each node, spread evenly over the half branches there: j w Q = D^H I (Kirchhoff's law)
    branch          E . dl = z I + j w mu0 L I + D P Q / eps0
    L, P            double integrals of the Green's function over half branches and contacts (`green`)

The current falls along a half branch by the charge that stays there, so current and charge agree, also where wires join. A
contact is a straight piece from axis to axis with an impedance. It has inductance and no charge. An open contact carries no
current. At low frequency these are the equations of the resistors of measure/network.py.

The part of G in `green` is Hermitian and stores energy. The waves that leave the mesh add, for each direction and polarisation p,

    R = k Z0 / (4 A kz) v^* v^T,      v = p . (integral of t exp(j k . r) along the pieces)

so the power lost by the currents in R equals the power of the waves, and energy is conserved to round-off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy import sparse

from .green import SHORTEST, PieceKernel
from .waves import DOWN, LIGHT, UP, Z0, Angles, Scattering, mode_decay, polarisations

TOLERANCE = 1e-4  # of the amplitude of a wave between interpolated matrices: 0.001 dB of reflection loss
INTERVALS = 2  # of the first interpolation
SAME = 1e-12  # of a wave number: round-off


@dataclass(frozen=True, eq=False)
class ThinWires:
    """Branches and contacts of a periodic mesh. A shift counts the periods from the first end to the second."""

    cell: np.ndarray  # (2, 2) [m] rows are the periods, at any angle
    radius: float  # [m] equivalent radius of the yarn
    node: np.ndarray  # (node, 3) [m]
    branch_node: np.ndarray  # (branch, 2)
    branch_shift: np.ndarray  # (branch, 2)
    contact_node: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))  # (contact, 2)
    contact_shift: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))  # (contact, 2)
    branch_middle: np.ndarray | None = None  # (branch, 3) [m] where the halves meet, as drawn from the first end; None: straight

    @property
    def halves(self) -> tuple[np.ndarray, np.ndarray]:
        """(branch, 3) [m] of the first halves and of the second ones."""
        branch = self._span(self.branch_node, self.branch_shift)
        first = 0.5 * branch if self.branch_middle is None else self.branch_middle - self.node[self.branch_node[:, 0]]
        return first, branch - first

    @property
    def contacts(self) -> np.ndarray:
        """(contact, 3) [m] from axis to axis."""
        return self._span(self.contact_node, self.contact_shift)

    def _span(self, ends: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """(branch, 3) or (contact, 3) [m] from the first end to the second."""
        span = self.node[ends[:, 1]] - self.node[ends[:, 0]]
        span[:, :2] += shift @ self.cell
        return np.asarray(span)


class StoredEnergy(NamedTuple):
    """Matrices (current, current) of the energy that the near field stores."""

    inductance: np.ndarray  # [m] L / mu0
    potential: np.ndarray  # [1/m] D P D^H

    def impedance(self, k: float) -> np.ndarray:
        """(current, current) [Ohm]."""
        return 1j * Z0 * (k * self.inductance - self.potential / k)


class MeshCurrents:
    """The integral equation of a mesh. The geometry and the static integrals are found once, for all frequencies and angles."""

    def __init__(self, wires: ThinWires) -> None:
        self.wires = wires
        start, (first, second), contact = wires.node[wires.branch_node[:, 0]], wires.halves, wires.contacts
        self.branch_count, self.contact_count = len(first), len(contact)
        # first halves of the branches, second halves where their branch is drawn, contacts
        vector = np.concatenate([first, second, contact])
        begin = np.concatenate([start, start + first, wires.node[wires.contact_node[:, 0]]])
        self.kernel = PieceKernel(wires.cell, wires.radius, begin + 0.5 * vector, vector)
        tangent = vector / np.maximum(self.kernel.length, SHORTEST)[:, None]
        self.alignment = tangent @ tangent.T
        self.half_node = wires.branch_node.T.ravel()
        halves = self.kernel.length[: 2 * self.branch_count]
        self.node_length = np.bincount(self.half_node, halves, minlength=len(wires.node))

    def stored(self, k: float, angles: Angles) -> StoredEnergy:
        """The matrices at one wave number [1/m]: nearly all of the work of a frequency."""
        transverse = angles.transverse(k)
        kernel = self.kernel.regular(k, transverse)
        charge, current = self._spread(transverse)
        return StoredEnergy(
            inductance=current.conj().T @ ((kernel * self.alignment) @ current), potential=charge.conj().T @ (kernel @ charge)
        )

    def scattering(
        self, k: float, angles: Angles, stored: StoredEnergy, wire: complex, contacts: Sequence[np.ndarray]
    ) -> list[Scattering]:
        """Scattered waves, from the matrices `stored` at the same wave number and angles.

        wire: [Ohm/m] impedance of the wire. contacts: for each result the admittances [contact] [S]; 0 is open, inf perfect.
        The currents of the branches are eliminated once for all results.
        """
        transverse, b = angles.transverse(k), self.branch_count
        _, current = self._spread(transverse)
        length = sparse.diags_array(self.kernel.length * (np.arange(len(self.kernel.length)) < 2 * b))
        leaving = self._leaving(k, transverse, angles.phi, current)
        impedance = stored.impedance(k) + wire * (current.conj().T @ length @ current).toarray()
        for wave in leaving:
            impedance += wave.resistance
        down = polarisations(k, transverse, DOWN, angles.phi)
        incoming = np.array([*transverse, -np.sqrt(k**2 - transverse @ transverse)])
        voltage = current.conj().T @ (self._moment(incoming).conj() @ down.T)
        in_branches = np.linalg.solve(impedance[:b, :b], np.concatenate([impedance[:b, b:], voltage[:b]], axis=1))
        drawn, driven = in_branches[:, :-2], in_branches[:, -2:]
        between = impedance[b:, b:] - impedance[b:, :b] @ drawn
        across = voltage[b:] - impedance[b:, :b] @ driven
        found = []
        for admittance in contacts:
            conducts = np.flatnonzero(admittance)
            matrix = between[np.ix_(conducts, conducts)] + np.diag(1.0 / admittance[conducts])
            flow = np.zeros((len(admittance), 2), dtype=complex)
            flow[conducts] = np.linalg.solve(matrix, across[conducts])
            found.append(_waves(leaving, np.concatenate([driven - drawn @ flow, flow])))
        return found

    def _leaving(self, k: float, transverse: np.ndarray, phi: float, current: sparse.csr_array) -> list[_Leaving]:
        """The waves that leave: up and down, specular and in lobes."""
        found = []
        for g in self.kernel.modes[mode_decay(k, self.kernel.modes + transverse).real == 0.0]:
            kg = transverse + g
            kz = float(np.sqrt(k**2 - kg @ kg))
            for direction in (UP, DOWN):
                across = polarisations(k, kg, direction, phi) @ self._moment(np.array([*kg, direction * kz])).T
                found.append(
                    _Leaving(
                        direction=direction,
                        is_specular=not g.any(),
                        moment=across @ current,
                        strength=k * Z0 / (2.0 * self.kernel.area * kz),
                        power=kz / float(np.sqrt(k**2 - transverse @ transverse)),
                    )
                )
        return found

    def _moment(self, wave: np.ndarray) -> np.ndarray:
        """(piece, 3) [m] integral of t exp(j wave . r) along the pieces, for a wave vector (3,) [1/m]."""
        middle, vector = self.kernel.middle, self.kernel.vector
        return np.asarray(vector * (np.exp(1j * middle @ wave) * np.sinc(vector @ wave / (2.0 * np.pi)))[:, None])

    def _spread(self, transverse: np.ndarray) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Charges and currents (piece, current) of the pieces, with a transverse wave vector (2,) [1/m].

        Charge per length times j w [1/m]; current in the middle of a piece.
        """
        wires, b, c, pieces = self.wires, self.branch_count, self.contact_count, len(self.kernel.length)
        ends = np.concatenate([wires.branch_node, wires.contact_node])
        shift = np.concatenate([wires.branch_shift, wires.contact_shift])
        jump = np.exp(-1j * (shift @ wires.cell) @ transverse) if transverse.any() else np.ones(b + c)
        row, shape, halves = np.arange(b + c), (b + c, len(wires.node)), np.arange(2 * b)
        drop = sparse.csr_array((jump, (row, ends[:, 1])), shape) - sparse.csr_array((np.ones(b + c), (row, ends[:, 0])), shape)
        per_length = np.concatenate([np.ones(b), jump[:b]]) / self.node_length[self.half_node]  # a second half is at an image
        charge = sparse.csr_array((per_length, (halves, self.half_node)), (pieces, len(wires.node))) @ drop.conj().T
        place = np.concatenate([halves, 2 * b + np.arange(c)]), np.concatenate([halves % b, b + np.arange(c)])
        fall = 0.5 * self.kernel.length * np.where(np.arange(pieces) < b, -1.0, 1.0)
        current = sparse.csr_array((np.ones(pieces), place), (pieces, b + c)) - sparse.diags_array(fall) @ charge
        return charge.tocsr(), current.tocsr()


@dataclass(frozen=True, eq=False)
class _Leaving:
    """A wave that leaves the mesh, in both polarisations."""

    direction: float  # UP or DOWN
    is_specular: bool  # else in a lobe
    moment: np.ndarray  # (polarisation, current) [m]
    strength: float  # [Ohm/m2] k Z0 / (2 A kz): minus the amplitude over moment and current
    power: float  # kz over the incident wave's

    @property
    def resistance(self) -> np.ndarray:
        """(current, current) [Ohm] of the power of the wave."""
        return 0.5 * self.strength * (self.moment.conj().T @ self.moment)


def _waves(leaving: Sequence[_Leaving], flow: np.ndarray) -> Scattering:
    """The waves of currents (current, in) [A]."""
    lobes, specular = np.zeros(2), {UP: np.zeros((2, 2), dtype=complex), DOWN: np.eye(2, dtype=complex)}
    for wave in leaving:
        amplitude = -wave.strength * (wave.moment @ flow)
        if wave.is_specular:
            specular[wave.direction] = specular[wave.direction] + amplitude
        else:
            lobes += wave.power * (np.abs(amplitude) ** 2).sum(axis=0)
    return Scattering(specular[UP], specular[DOWN], lobes)


def scattering_at(
    mesh: MeshCurrents,
    frequencies: Sequence[float],
    angles: Angles,
    wire: Callable[[float], complex],
    contacts: Callable[[float], list[np.ndarray]],
) -> list[list[Scattering]]:
    """Waves at frequencies [Hz], for each state of the contacts.

    The matrices of `StoredEnergy` take nearly all of the time of a frequency, and are smooth below the first grating lobe:
    resonances are in their inverse alone. So they are interpolated between Chebyshev-Lobatto points, which are doubled until the
    last interpolation predicts the waves at the new points within TOLERANCE. The result has the new points as well, so its
    error is smaller. The matrices of each frequency are found where that takes no more points.

    wire: [Ohm/m] impedance of the wire at a frequency. contacts: admittances [contact] [S] of each state at a frequency.
    """

    def waves(k: float, stored: StoredEnergy) -> list[Scattering]:
        frequency = k * LIGHT / (2.0 * np.pi)
        return mesh.scattering(k, angles, stored, wire(frequency), contacts(frequency))

    wave_numbers = [2.0 * np.pi * frequency / LIGHT for frequency in frequencies]
    low, high, intervals, error = min(wave_numbers), max(wave_numbers), INTERVALS, np.inf
    points, known = _points(low, high, intervals), np.zeros(0)
    while 2 * intervals + 1 < len(wave_numbers) and error >= TOLERANCE:
        if not known.size:
            known = np.array([mesh.stored(k, angles) for k in points])
        intervals *= 2
        finer = _points(low, high, intervals)
        new = [mesh.stored(k, angles) for k in finer[1::2]]
        error = max(
            float(np.abs(one.reflection - other.reflection).max())
            for k, exact in zip(finer[1::2], new, strict=True)
            for one, other in zip(waves(k, _between(points, known, k)), waves(k, exact), strict=True)
        )
        points, known = finer, np.insert(known, range(1, len(points)), new, axis=0)
    if error < TOLERANCE:
        return [waves(k, _between(points, known, k)) for k in wave_numbers]
    return [waves(k, mesh.stored(k, angles)) for k in wave_numbers]


def _points(low: float, high: float, intervals: int) -> list[float]:
    """Chebyshev-Lobatto points; half the intervals have every second point."""
    return (0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * np.arange(intervals + 1) / intervals)).tolist()


def _between(points: Sequence[float], known: np.ndarray, k: float) -> StoredEnergy:
    """Matrices at a wave number [1/m]: barycentric interpolation of known ones (point, 2, current, current)."""
    away = k - np.array(points)
    if (at := np.flatnonzero(np.abs(away) < SAME * points[-1])).size:
        return StoredEnergy(*known[at[0]])
    weight = (-1.0) ** np.arange(len(points)) / away
    weight[[0, -1]] *= 0.5
    return StoredEnergy(*np.tensordot(weight / weight.sum(), known, 1))
