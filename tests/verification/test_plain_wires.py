"""Straight and nearly straight wires from a file: tensions in closed form, in few steps.

The dynamics of a relaxation stretch as easily as loops do; a straight wire does not, and has its true stiffness in them:

    T = EA e between clamps        1/K = 1/EA + BENT_SHARE <y^2>/EI for a wire with the distances y from its line
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from warpknit import Simulation, build_model, load_scene
from warpknit.base.errors import ModelError
from warpknit.compute.ranks import Ranks
from warpknit.spatial.rods import BENT_SHARE, Section, rods_of

DIAMETER, STRAIN = 0.1, 1e-3  # [mm]


def simulation_of(
    folder: Path, wires: list[np.ndarray], period: tuple[float, float] | None = None, **tables: object
) -> Simulation:
    """Wires of points [mm], drawn by STRAIN along the weft."""
    rows = [f"{wire},{x:.12g},{y:.12g},{z:.12g}" for wire, points in enumerate(wires) for x, y, z in points]
    (folder / "wires.csv").write_text("\n".join(["wire,x [mm],y [mm],z [mm]", *rows]))
    own = {"file": folder / "wires.csv", "node_spacing": f"{DIAMETER} mm"}
    scene = {
        "wires": own if period is None else own | {"period": [f"{side} mm" for side in period]},
        "wire": {"diameter": f"{DIAMETER} mm"},
        "load": {"strain_weft": STRAIN},
        "contact": {"friction": 0.0},
    } | tables
    return Simulation(build_model(load_scene(scene)))


def line(start: tuple[float, float, float], end: tuple[float, float, float]) -> np.ndarray:
    return np.linspace(start, end, 9)


def test_three_straight_wires_carry_their_true_tension_after_few_steps(tmp_path: Path) -> None:
    """T = EA e at 20 load levels; nothing is softened, so multipliers have no error to remove."""
    simulation = simulation_of(tmp_path, [line((0, y, 0), (4, y, 0)) for y in (0.0, 0.5, 1.0)])
    *_, last = simulation.run()
    section, observed = simulation.model.rods.section, last.observables
    free = simulation.model.rods.following >= 0
    np.testing.assert_allclose(np.median(observed.tension[free]), section.axial_stiffness * STRAIN, rtol=1e-5)
    assert last.steps < 3_000


def test_worlds_of_straight_wires_have_tensions_of_their_own_sections(tmp_path: Path) -> None:
    """T = E pi d^2/4 e of each world: tensions of wires side by side are as the squares of their diameters."""
    diameters = DIAMETER * np.array([1.0, 0.8, 1.25])
    wires = [line((0, y, 0), (4, y, 0)) for y in (0.0, 0.5)]
    models = [simulation_of(tmp_path, wires, wire={"diameter": f"{diameter} mm"}).model for diameter in diameters]
    base, *_ = models
    wide = replace(base, scene=replace(base.scene, variants=replace(base.scene.variants, wire=0.1)))  # up to 1.35 times
    worlds = [model.beside(wide) for model in models]
    last = {record.world: record for record in Simulation(worlds[0], worlds=worlds).run()}
    free = base.rods.following >= 0
    tensions = [np.median(last[world].observables.tension[free]) for world in range(len(diameters))]
    modulus = base.scene.wire.youngs_modulus
    np.testing.assert_allclose(tensions, modulus * math.pi / 4.0 * (1e-3 * diameters) ** 2 * STRAIN, rtol=1e-5)


def test_two_wires_that_cross_and_overlap_part_and_converge_after_few_steps(tmp_path: Path) -> None:
    """The wire along the weft carries T = EA (e + b^2/2), with the slope b of the half overlap over the half span."""
    simulation = simulation_of(tmp_path, [line((0, 0, 0), (4, 0, 0)), line((2, -2, 0.7 * DIAMETER), (2, 2, 0.7 * DIAMETER))])
    *_, last = simulation.run()
    rods = simulation.model.rods
    tension = np.median(last.observables.tension[: int(rods.wire_count[0])])
    bow = 0.5 * (0.15 * DIAMETER / 2.0) ** 2  # strain by the overlap, of which each wire takes up a half
    np.testing.assert_allclose(tension, rods.section.axial_stiffness * (STRAIN + bow), rtol=0.01)
    assert last.steps < 4_000


def test_stability_is_tested_before_the_load_and_at_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And where 0.1 % of strain have passed since: once on the way to 0.15 % in four levels."""
    begun: list[float] = []
    simulation = simulation_of(
        tmp_path,
        [line((0, 0, 0), (4, 0, 0)), line((2, -2, 0.7 * DIAMETER), (2, 2, 0.7 * DIAMETER))],
        load={"strain_weft": 1.5 * STRAIN},
        output={"frames": 4},
    )
    monkeypatch.setattr(simulation.mechanics.stability, "begin", lambda world: begun.append(simulation.progress.load_factor))
    list(simulation.run())
    assert begun == [0.0, 0.75, 1.0]


def test_a_weave_of_sine_waves_converges_after_few_steps(tmp_path: Path) -> None:
    """Wires of one repeat pass over and under each other; both directions are alike, so their tensions are the same."""
    wave = np.linspace(0.0, 4.0, 65)
    height = 0.51 * DIAMETER * np.sin(np.pi * wave)
    along = [np.stack([wave, np.full(65, k + 0.5), (-1) ** k * height], axis=1) for k in range(4)]
    across = [np.stack([np.full(65, k + 0.5), wave, (-1) ** (k + 1) * height], axis=1) for k in range(4)]
    tables = {"model": {"boundary": "periodic"}, "load": {"strain_weft": STRAIN, "strain_warp": STRAIN}}
    simulation = simulation_of(tmp_path, along + across, (4.0, 4.0), **tables)
    *_, last = simulation.run()
    stress = last.observables.nominal_stress
    np.testing.assert_allclose(stress[0, 0], stress[1, 1], rtol=1e-3)
    assert last.steps < 6_000


def test_wires_that_overlap_at_their_clamps_are_refused(tmp_path: Path) -> None:
    """By both wires and the depth; at a touch they are not."""
    for gap, is_refused in ((0.8, True), (0.999, True), (1.0, False)):
        simulation = simulation_of(tmp_path, [line((0, y, 0), (4, y, 0)) for y in (0.0, gap * DIAMETER)])
        if is_refused:
            with pytest.raises(ModelError, match=r"wires 1 and 2 overlap by "):
                simulation.compile()
        else:
            simulation.compile()


def test_the_stiffness_of_a_wire_is_that_of_a_bent_spring() -> None:
    """A straight wire: EA. A sine wave of amplitude a: <y^2> = a^2/2. A ring of radius r: <y^2> = r^2."""
    section = Section(
        axial_stiffness=2.0, bending_stiffness=0.5, twist_stiffness=0.5, linear_density=1.0, rotary_inertia=1.0, thickness=0.01
    )
    arc = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    none = np.zeros(64)
    straight, wave = np.stack([arc, none, none], axis=1), np.stack([arc, 0.3 * np.sin(arc), none], axis=1)
    ring = np.stack([np.cos(arc), np.sin(arc), none + 5.0], axis=1)
    rods = rods_of(section, [straight, wave, ring], [np.array([2.0 * np.pi, 0.0, 0.0])] * 2 + [np.zeros(3)])
    wanted = [1.0 / (1.0 / 2.0 + BENT_SHARE * square / 0.5) for square in (0.0, 0.5 * 0.3**2, 1.0)]
    np.testing.assert_allclose(rods.wire_stiffness, wanted, rtol=1e-12)


def test_a_sum_beyond_the_largest_number_is_not_a_number() -> None:
    sums = Ranks().exact_sum(np.array([[1e308, np.inf, 1.0], [1e308, -np.inf, 2.0]]))
    assert math.isnan(sums[0]) and math.isnan(sums[1]) and sums[2] == 3.0
