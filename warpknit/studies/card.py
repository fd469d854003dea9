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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from .. import measure
from ..measure import Observables
from ..measure.table import Record
from ..results.row import Row
from ..scene import Stage
from .load_path import Load, LoadPath, Meshes, Monitor, PathState, follow, part_of, under_strain

STEP = 1e-3  # strain step of the finite differences
LEAST_STEP = 0.25 * STEP  # down to which it is halved while they disagree: a contact may close or part near the state
CYCLE = 1e-4  # the same with friction or yield, amplitude of small cycles: the more contacts slip, the larger it is
BESIDE = 2.0  # amplitudes along the load, or back, to the middle of these differences
HEATED = 100.0  # [K] change of temperature for the expansion of a mesh with a history
AGREEMENT = 0.05  # of the largest stiffness: larger changes from twice the step, or a larger asymmetry, give a warning
WAVE_DIRECTIONS = 180  # directions of plane waves
_Slopes: TypeAlias = tuple[np.ndarray, np.ndarray]
VOIGT = np.array([[0, 2], [2, 1]])  # row of the stiffness for a pair of axes


@dataclass(frozen=True)
class History:
    """Properties under loading and cooling of a mesh with friction or yield."""

    loading: np.ndarray  # (3, 3) [N/m] tangent stiffness along the load, row S, column E; not symmetric
    difference: float  # change from differences of twice the step, over its largest entry
    cooling: np.ndarray  # (3,) [1/K] strain E at constant S while the heated mesh cools to its temperature


def tension_slope_of(stiffness: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """(2, 2) [N/m] D of a stiffness C, at a tension (2,) [N/m] in weft and warp."""
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
        return tension_slope_of(self.stiffness, self.tension)

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


def find_cards(
    meshes: Meshes,
    begin: Mapping[int, PathState],
    load: Mapping[int, Stage],
    ahead: Mapping[int, Stage],
    monitor: Monitor = lambda _: None,
) -> dict[int, tuple[MaterialCard, Record]]:
    """The cards of meshes and the tensioned meshes, by place; without meshes that do not converge.

    meshes: periodic. begin: a state near each, at which differences of all meshes start side by side. load: of each mesh. ahead:
    loads a little further on, for meshes with friction or yield. `monitor` is called with the completed share of the states.
    Raises `Diverged` where too few for a mean converge.
    """
    path = LoadPath(meshes, begin)
    bases = path.to(load)
    near = _Near(meshes, path.states, {place: record.observables.gradient for place, record in bases.items()})
    if meshes.scene.depends_on_path:
        onwards = LoadPath(meshes, path.states).to({place: ahead[place] for place in path.states})
        along = {place: _along(record.observables.gradient, near.tensioned[place]) for place, record in onwards.items()}
        back = near.differences(CYCLE, {place: -strain for place, strain in along.items()}, monitor=part_of(monitor, 0, 3))
        loading = near.differences(CYCLE, along, monitor=part_of(monitor, 1, 3))
        heated, cooled = _expansions(meshes, path.states, bases, load)
        monitor(1.0)
        histories = {
            place: History(one.tangent, one.step_difference, cooled[place]) for place, one in loading.items() if place in cooled
        }
        return {
            place: (_card(bases[place], back[place], heated[place], history), bases[place])
            for place, history in histories.items()
            if place in back
        }
    found = near.differences(STEP, dict.fromkeys(bases, np.zeros(3)), least=LEAST_STEP, monitor=monitor)
    cards = {}
    for place, one in found.items():
        expansion = -np.linalg.solve(one.stiffness, one.by_length) * meshes.scene.wire.expansion
        cards[place] = _card(bases[place], one, expansion, None), bases[place]
    return cards


def _along(onwards: np.ndarray, tensioned: np.ndarray) -> np.ndarray:
    """Strain (3,) from a tensioned state towards another, BESIDE in its largest component."""
    along = green(onwards @ np.linalg.inv(tensioned))
    return np.asarray(along * BESIDE / np.abs(along).max())


def _card(base: Record, differences: _Differences, expansion: np.ndarray, history: History | None) -> MaterialCard:
    state = base.observables
    weft, warp = (float(strain) for strain in np.diag(state.gradient) - 1.0)
    tension = measure.mesh_tension(state)
    return MaterialCard(
        strain_weft=weft,
        strain_warp=warp,
        tension_weft=tension[0],
        tension_warp=tension[1],
        stiffness=differences.stiffness,
        asymmetry=differences.asymmetry,
        step_difference=differences.step_difference,
        difference_step=differences.step,
        expansion=expansion,
        areal_mass=measure.areal_mass(state),
        stress_max=measure.largest_stress(state),
        active_percent=measure.contacts(state).active_percent,
        temperature=state.model.scene.stages[0].temperature,
        history=history,
    )


def _expansions(
    meshes: Meshes, states: Mapping[int, PathState], bases: Mapping[int, Record], load: Mapping[int, Stage]
) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
    """Strain E a kelvin (3,) [1/K] at a constant tension, by place: while heated by HEATED, and while cooling back."""
    path, strains = LoadPath(meshes, states), [dict.fromkeys(states, np.zeros(3))]
    for name, change in (("heated", HEATED), ("cooled", 0.0)):
        held = {}
        for place in path.states:
            weft, warp = measure.mesh_tension(bases[place].observables)
            stage = replace(load[place], strain_weft=None, strain_warp=None, tension_weft=weft, tension_warp=warp)
            held[place] = replace(stage, name=name, temperature=stage.temperature + change)
        ends = {place: record.observables.gradient for place, record in path.to(held).items()}
        strains.append({place: green(end @ np.linalg.inv(bases[place].observables.gradient)) for place, end in ends.items()})
    begin, heated, cooled = strains
    return (
        {place: (strain - begin[place]) / HEATED for place, strain in heated.items()},
        {place: (heated[place] - strain) / HEATED for place, strain in cooled.items()},
    )


@dataclass(frozen=True)
class _Near:
    """Tensioned meshes, and equilibria near them; all by place."""

    meshes: Meshes
    states: Mapping[int, PathState]
    tensioned: Mapping[int, np.ndarray]  # (2, 2) deformation gradients

    def differences(
        self, step: float, beside: Mapping[int, np.ndarray], *, least: float = np.inf, monitor: Monitor
    ) -> dict[int, _Differences]:
        """Derivatives about a strain of `beside` (3,) steps from the tensioned states; without meshes that do not converge.

        Of each mesh the most consistent step from `least` on.
        """
        coarse, fine = self._slopes((2.0 * step, step), beside)
        best = {place: _Differences.of(coarse[place], slope, step) for place, slope in fine.items()}
        while step > least and (more := {place: beside[place] for place, one in best.items() if one.error > AGREEMENT}):
            monitor(0.5)
            step *= 0.5
            coarse, (fine,) = fine, self._slopes((step,), more)
            for place, slope in fine.items():
                best[place] = min(best[place], _Differences.of(coarse[place], slope, step), key=lambda one: one.error)
        monitor(1.0)
        return best

    def _slopes(self, sizes: Sequence[float], beside: Mapping[int, np.ndarray]) -> list[dict[int, _Slopes]]:
        """By E11, E22, 2 E12, for each size of a step: slopes of stress (3, 3), and of energy by length factor (3,)."""
        steps = {
            place: [stretch(size * (middle + sign * along)) for size in sizes for along in np.eye(3) for sign in (1.0, -1.0)]
            for place, middle in beside.items()
        }
        models = {place: self.meshes.models[place] for place in steps}
        loads = [
            Load(place, mesh, under_strain(mesh.scene, f @ self.tensioned[place]), self.states[place])
            for place, mesh in models.items()
            for f in steps[place]
        ]
        ends = iter(follow(loads, 1))
        found: list[dict[int, _Slopes]] = [{} for _ in sizes]
        for place, mesh in models.items():
            of_mesh = [next(ends) for _ in steps[place]]
            if any(one.end is None for one in of_mesh):
                continue
            area = mesh.panel.area * float(np.linalg.det(self.tensioned[place]))
            states = [one.records[-1].observables for one in of_mesh]
            values = [
                (*_stress(r, f, self.tensioned[place]), r.thermal_force / area) for f, r in zip(steps[place], states, strict=True)
            ]
            for size, of_size, pairs in zip(sizes, found, np.reshape(values, (len(sizes), 3, 2, 4)), strict=True):
                slope = (pairs[:, 0] - pairs[:, 1]) / (2.0 * size)
                of_size[place] = slope[:, :3], slope[:, 3]
        return found


@dataclass(frozen=True)
class _Differences:
    """Derivatives by differences of one step, and their change at twice the step."""

    tangent: np.ndarray  # (3, 3) [N/m] row stress, column strain
    by_length: np.ndarray  # (3,) [N/m]
    step_difference: float  # over the largest stiffness, as asymmetry
    step: float

    @classmethod
    def of(cls, coarse: _Slopes, fine: _Slopes, step: float) -> _Differences:
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
