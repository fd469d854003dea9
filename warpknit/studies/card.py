"""The orthotropic material card of a mesh under tension: tangent membrane stiffness and thermal expansion.

The mesh is in equilibrium at a deformation gradient F0, and from there strained a little further by f, F = f F0. Everything
refers to the tensioned mesh: its width and length count as 1, and its tension is the prestress of the FE model.

    stress   S = f^-1 P F0^T / det F0 [N/m]   second Piola-Kirchhoff, P the nominal stress of measure/__init__.py
    strain   E = (f^T f - 1) / 2              Green-Lagrange
    C = dS/dE at f = 1                        by central differences, symmetric as S = dw/dE

Geometric stiffness is not in C: an FE model with prestress adds it. With w the energy per tensioned area and L the length factor
of the wires, dS/dL = d(dw/dL)/dE follows from the same states, and heat changes S by -C alpha per kelvin,

    alpha = -C^-1 (dS/dL) alpha_wire.

A test machine measures D, the change of the true tension s by the strains e, with geometric stiffness,

    D_ii = C_ii + s_i     D_12 = C_12 - s_1     D_21 = C_12 - s_2.

With friction or yield S depends on direction and size of a strain, and there is no w. C then holds for small cycles, of CYCLE
about a state unloaded by twice as much, where most contacts stick. Differences about a state loaded further give the tangent of
loading, which is not symmetric. alpha is found by heating the mesh under its tension, cooling_alpha by cooling it back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from .. import measure
from ..measure import Observables
from ..results.row import Row
from ..scene import Stage
from .load_path import LoadPath, Mesh, PathState, ends_beside, part_of, under_strain

STEP = 1e-3  # strain step of the finite differences
LEAST_STEP = 0.25 * STEP  # down to which it is halved while they disagree: a contact may close or part near the state
CYCLE = 1e-4  # the same with friction or yield, amplitude of small cycles: the more contacts slip, the larger it is
BESIDE = 2.0  # amplitudes along the load, or back, to the middle of these differences
HEATED = 100.0  # [K] change of temperature for the expansion of a mesh with a history
AGREEMENT = 0.05  # of the largest stiffness: larger changes from twice the step, or a larger asymmetry, give a warning
WAVE_DIRECTIONS = 180  # directions of plane waves
VOIGT = np.array([[0, 2], [2, 1]])  # row of the stiffness for a pair of axes


@dataclass(frozen=True)
class History:
    """Properties under loading and cooling of a mesh with friction or yield."""

    loading: np.ndarray  # (3, 3) [N/m] tangent stiffness along the load, row S, column E; not symmetric
    difference: float  # change from differences of twice the step, over its largest entry
    cooling: np.ndarray  # (3,) [1/K] strain E at constant S while the heated mesh cools to its temperature

    def tension_slope(self, tension: np.ndarray) -> np.ndarray:
        """(2, 2) [N/m] derivative of the tensions (2,) by the strains, as the load goes on."""
        return _tension_slope(self.loading, tension)


def _tension_slope(stiffness: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """(2, 2) [N/m] D of a stiffness C."""
    return np.asarray(stiffness[:2, :2] + np.diag(tension) - tension[:, None] * (1.0 - np.eye(2)))


@dataclass(frozen=True)
class MaterialCard:
    """Tangent properties of a tensioned mesh; index 1 is weft, 2 warp, 3 shear (engineering shear strain)."""

    strain_weft: float  # of the tensioned mesh relative to the mesh as knitted
    strain_warp: float
    tension_weft: float  # [N/m] force per current width
    tension_warp: float
    stiffness: np.ndarray  # (3, 3) [N/m] symmetric
    asymmetry: float  # of the finite-difference stiffness, over its largest entry
    step_difference: float  # change of the stiffness from differences of twice the step, over its largest entry
    expansion: np.ndarray  # (3,) [1/K] strain E at constant S, with friction or yield while the mesh is heated
    areal_mass: float  # [kg/m2] of the tensioned mesh
    stress_max: float  # [Pa] in the wire of the tensioned mesh
    active_percent: float  # contacts of the tensioned mesh
    temperature: float  # [K] of the mesh
    difference_step: float = STEP  # strain step of the differences
    jumps: str = ""  # sentence on snap-throughs on the load path to the mesh
    branch: str = ""  # sentence on another equilibrium that the report found under its load
    ahead: str = ""  # distance to the next snap-through and to first yield, in words
    history: History | None = None  # with friction or yield

    @property
    def of_loading(self) -> MaterialCard | None:
        """The card for further loading: the symmetric part of its tangent as the stiffness; None without a history."""
        if self.history is None:
            return None
        tangent, difference = self.history.loading, self.history.difference
        asymmetry = float(np.abs(tangent - tangent.T).max() / np.abs(tangent).max())
        symmetric = 0.5 * (tangent + tangent.T)
        return replace(self, stiffness=symmetric, asymmetry=asymmetry, step_difference=difference, history=None)

    @property
    def row(self) -> Row:
        """Strains, active contacts and largest stress by their names in history.csv."""
        strains = {"strain_weft": self.strain_weft, "strain_warp": self.strain_warp}
        return Row(**strains, active_percent=self.active_percent, stress_max_Pa=self.stress_max)

    @property
    def poissons_ratios(self) -> tuple[float, float]:
        """nu12: -E22 over E11 for a change of S11 at constant S22; nu21: with the axes exchanged."""
        c = self.stiffness
        return float(c[0, 1] / c[1, 1]), float(c[0, 1] / c[0, 0])

    @property
    def moduli(self) -> tuple[float, float]:
        """[N/m] E1: S11 over E11 at constant S22; E2: with the axes exchanged. Without geometric stiffness."""
        c = self.stiffness
        return float(c[0, 0] - c[0, 1] ** 2 / c[1, 1]), float(c[1, 1] - c[0, 1] ** 2 / c[0, 0])

    @property
    def tension(self) -> np.ndarray:
        """(2,) [N/m] in weft and warp."""
        return np.array([self.tension_weft, self.tension_warp])

    @property
    def tension_slope(self) -> np.ndarray:
        """(2, 2) [N/m] derivative of the tensions (force per current width) by the strains, in weft and warp."""
        return _tension_slope(self.stiffness, self.tension)

    @property
    def difference(self) -> float:
        """Error estimate of the stiffness: the larger of `step_difference` and `asymmetry`."""
        return max(self.step_difference, self.asymmetry)

    @property
    def shear_coupling(self) -> float:
        """Largest coupling of shear to extension, over the largest stiffness; zero for an orthotropic mesh."""
        return float(np.abs(self.stiffness[:2, 2]).max() / np.abs(self.stiffness).max())

    @property
    def is_stable(self) -> bool:
        """Whether the stiffness is positive definite."""
        return bool(np.linalg.eigvalsh(self.stiffness).min() > 0.0)

    @property
    def softest(self) -> int:
        """Row (0 weft, 1 warp, 2 shear) with the largest component of the softest strain."""
        return int(np.argmax(np.abs(np.linalg.eigh(self.stiffness)[1][:, 0])))

    @property
    def least_wave_stiffness(self) -> float:
        """[N/m] smallest stiffness against a plane wave in the prestressed mesh; an FE model is stable if it is positive.

        Smallest eigenvalue of Q_ik = C_ijkl n_j n_l + (n . S n) delta_ik over all directions n.
        """
        c = self.stiffness
        stiffness = c[VOIGT[:, :, None, None], VOIGT]
        angle = np.linspace(0.0, np.pi, WAVE_DIRECTIONS, endpoint=False)
        n = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        acoustic = np.einsum("ijkl,mj,ml->mik", stiffness, n, n)
        acoustic += (n**2 @ [self.tension_weft, self.tension_warp])[:, None, None] * np.eye(2)
        return float(np.linalg.eigvalsh(acoustic).min())


def stretch(strain: np.ndarray) -> np.ndarray:
    """Upper triangular f (2, 2) whose Green-Lagrange strain is E11, E22, 2 E12 = `strain` (3,)."""
    a = np.sqrt(1.0 + 2.0 * strain[0])
    b = strain[2] / a
    return np.array([[a, b], [0.0, np.sqrt(1.0 + 2.0 * strain[1] - b * b)]])


def green(f: np.ndarray) -> np.ndarray:
    """(3,) Green-Lagrange strain E11, E22, 2 E12 of f (2, 2)."""
    strain = 0.5 * (f.T @ f - np.eye(2))
    return np.array([strain[0, 0], strain[1, 1], 2.0 * strain[0, 1]])


def find_card(
    model: Mesh, begin: PathState, load: Stage, monitor: Callable[[float], None] = lambda _: None, *, ahead: Stage | None = None
) -> tuple[MaterialCard, Observables]:
    """The card under `load` and the tensioned mesh, from a state near it. model: periodic, see `exact_model`.

    All states of the differences start from that mesh. `monitor` is called with the completed share of the states. ahead: a load
    a little further on, for a mesh with friction or yield. Raises `Diverged` where the mesh does not converge.
    """
    path = LoadPath(model, begin)
    base = path.to(load).observables
    has_history = model.scene.depends_on_path
    find = partial(_differences, model, path.state, base.gradient)
    history = None
    if has_history:
        assert ahead is not None
        onwards = LoadPath(model, path.state).to(ahead).observables.gradient
        along = green(onwards @ np.linalg.inv(base.gradient))
        along *= BESIDE / np.abs(along).max()
        differences, loading = (find(CYCLE, sign * along, monitor=part_of(monitor, k, 3)) for k, sign in enumerate((-1.0, 1.0)))
        expansion, cooling = _expansions(model, path.state, base, load)
        monitor(1.0)
        history = History(loading.tangent, loading.step_difference, cooling)
    else:
        differences = find(STEP, least=LEAST_STEP, monitor=monitor)
        expansion = -np.linalg.solve(differences.stiffness, differences.by_length) * model.scene.wire.expansion
    weft, warp = (float(strain) for strain in np.diag(base.gradient) - 1.0)
    tension = measure.mesh_tension(base)
    card = MaterialCard(
        strain_weft=weft,
        strain_warp=warp,
        tension_weft=tension[0],
        tension_warp=tension[1],
        stiffness=differences.stiffness,
        asymmetry=differences.asymmetry,
        step_difference=differences.step_difference,
        difference_step=differences.step,
        expansion=expansion,
        areal_mass=measure.areal_mass(base),
        stress_max=measure.largest_stress(base),
        active_percent=measure.contacts(base).active_percent,
        temperature=model.scene.stages[0].temperature,
        history=history,
    )
    return card, base


def _expansions(model: Mesh, state: PathState, base: Observables, load: Stage) -> tuple[np.ndarray, np.ndarray]:
    """Strain E a kelvin (3,) [1/K] at a constant tension; while heated by HEATED, and while cooling back."""
    weft, warp = measure.mesh_tension(base)
    held = replace(load, strain_weft=None, strain_warp=None, tension_weft=weft, tension_warp=warp)
    path, strains = LoadPath(model, state), [np.zeros(3)]
    for name, change in (("heated", HEATED), ("cooled", 0.0)):
        found = path.to(replace(held, name=name, temperature=load.temperature + change)).observables
        strains.append(green(found.gradient @ np.linalg.inv(base.gradient)))
    return strains[1] / HEATED, (strains[1] - strains[2]) / HEATED


def _differences(
    model: Mesh,
    state: PathState,
    tensioned: np.ndarray,
    step: float,
    beside: np.ndarray | float = 0.0,
    *,
    least: float = np.inf,
    monitor: Callable[[float], None],
) -> _Differences:
    """Derivatives about a strain of `beside` (3,) steps from a tensioned state; the most consistent step from `least` on."""
    area = model.panel.area * float(np.linalg.det(tensioned))

    def slopes(*sizes: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Derivatives of stress (3, 3) and of energy by length factor (3,), for each step. By E11, E22, 2 E12."""
        steps = [stretch(size * (beside + sign * along)) for size in sizes for along in np.eye(3) for sign in (1.0, -1.0)]
        stages = [under_strain(model.scene, f @ tensioned) for f in steps]
        ends = ends_beside(model, state, stages)
        there = [(f, record.observables) for f, record in zip(steps, ends, strict=True)]
        values = [(*_stress(r, f, tensioned), r.thermal_force / area) for f, r in there]
        for size, found in zip(sizes, np.reshape(values, (len(sizes), 3, 2, 4)), strict=True):
            slope = (found[:, 0] - found[:, 1]) / (2.0 * size)
            yield slope[:, :3], slope[:, 3]

    coarse, fine = slopes(2.0 * step, step)
    best = _Differences.of(coarse, fine, step)
    while best.error > AGREEMENT and step > least:
        monitor(0.5)
        step *= 0.5
        coarse, (fine,) = fine, slopes(step)
        best = min(best, _Differences.of(coarse, fine, step), key=lambda one: one.error)
    monitor(1.0)
    return best


@dataclass(frozen=True)
class _Differences:
    """Derivatives by differences of one step, and their change at twice the step."""

    tangent: np.ndarray  # (3, 3) [N/m] row stress, column strain
    by_length: np.ndarray  # (3,) [N/m]
    step_difference: float  # over the largest stiffness, as asymmetry
    step: float

    @classmethod
    def of(cls, coarse: tuple[np.ndarray, np.ndarray], fine: tuple[np.ndarray, np.ndarray], step: float) -> _Differences:
        change = _symmetric(fine[0]) - _symmetric(coarse[0])
        return cls(fine[0].T, fine[1], float(np.abs(change).max() / np.abs(_symmetric(fine[0])).max()), step)

    @property
    def stiffness(self) -> np.ndarray:
        """(3, 3) [N/m] symmetric."""
        return _symmetric(self.tangent)

    @property
    def asymmetry(self) -> float:
        return float(np.abs(self.tangent - self.tangent.T).max() / np.abs(self.stiffness).max())

    @property
    def error(self) -> float:
        return max(self.asymmetry, self.step_difference)


def _symmetric(tangent: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (tangent + tangent.T))


def _stress(r: Observables, f: np.ndarray, tensioned: np.ndarray) -> tuple[float, float, float]:
    """S11, S22, S12 [N/m]."""
    s = np.linalg.solve(f, r.nominal_stress) @ tensioned.T / np.linalg.det(tensioned)
    return float(s[0, 0]), float(s[1, 1]), 0.5 * float(s[0, 1] + s[1, 0])
