"""Directions given by tension: their strain is an unknown of the relaxation (kernels/control.py)."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from reference.cases import slow
from warpknit import Simulation, build_model, load_scene, measure
from warpknit.base.errors import NotCarried
from warpknit.compute.steering import Steering
from warpknit.kernels.control import CONTROL_COUNT, PARTIAL_COUNT, STRESS_PART, update_control
from warpknit.measure.strain import clamp_rotation, rotation, stretch, true_stress
from warpknit.mechanics.driven_strain import TOLERANCE
from warpknit.mesh.rim import LoadPoint
from warpknit.runner.branches import with_work
from warpknit.runner.history import row_of
from warpknit.scene import Scene
from warpknit.solve.progress import Progress

KNITS = {
    "tricot": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}],
    "atlas": [{"chain": "1-0/1-2/2-3/3-4/3-2/2-1"}],
}


def scene_of(
    name: str = "tricot", boundary: str = "periodic", repeats: tuple[int, int] = (1, 1), kind: str = "spatial", **tables: dict
) -> Scene:
    return load_scene(
        {
            "wire": {"material": "molybdenum", "diameter": "30 um"},
            "knit": {"bars": KNITS[name], "wales": "26 /inch", "courses": "30 /inch", "repeats": list(repeats)},
            "model": {"kind": kind, "boundary": boundary},
            "contact": {"friction": 0.0},
            "variants": {"count": 1},
            "load": {"tension_weft": "1 N/m", "tension_warp": "1 N/m"},
            "solver": {"preset": "draft", "precision": "double"},
            "output": {"frames": 1},
        }
        | tables
    )


def last_of(scene: Scene) -> tuple[Simulation, object]:
    simulation = Simulation(build_model(scene))
    *_, last = simulation.run()
    return simulation, last


@pytest.mark.parametrize("kind", ["planar", "spatial"])
@pytest.mark.parametrize(
    ("boundary", "repeats", "friction", "rotation_deg"),
    [
        ("periodic", (1, 1), 0.0, 0.0),
        ("periodic", (1, 1), 0.2, 0.0),
        ("gripped", (3, 3), 0.0, 0.0),
        ("gripped", (3, 3), 0.0, 5.0),
    ],
)
def test_the_tension_of_a_step_is_that_of_its_state(boundary, repeats, friction, rotation_deg, kind) -> None:
    """From the forces of the step itself, in whole numbers: that of an evaluation of the same state, to their round-off."""
    simulation = Simulation(build_model(scene_of(boundary=boundary, repeats=repeats, kind=kind, contact={"friction": friction})))
    mechanics, rows = simulation.mechanics, np.array([0])
    group = mechanics.group
    mechanics.search()
    angle = np.radians(rotation_deg)
    gradient = rotation(angle).T @ np.array([[1.02, 0.01], [0.0, 1.01]])
    mechanics.set_load(LoadPoint(gradient, 293.15), 200)
    assert not group.advance(rows, 220)[1][0]
    mechanics.search()
    nominal, now = group.stress_at(rows)[0], mechanics.state.gradient
    expected = np.diag(true_stress(rotation(clamp_rotation(now)) @ nominal, stretch(now)))
    group.count_stress()
    mechanics.state.steering.set(is_driven=1.0, strain_mass=1e300, strain_range=np.inf)  # it does not move
    mechanics.step(1)
    assert mechanics.state.steering.tension == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    assert np.array_equal(mechanics.state.gradient, now)


@pytest.mark.parametrize("kind", ["planar", "spatial"])
@pytest.mark.parametrize("knit", ["tricot", "atlas"])
def test_by_tension_and_by_strain_the_same_equilibrium_is_found(knit: str, kind: str) -> None:
    scene = scene_of(knit, kind=kind, output={"frames": 3})
    _, by_tension = last_of(scene)
    assert measure.mesh_tension(by_tension.observables) == pytest.approx([1.0, 1.0], rel=TOLERANCE)
    weft, warp = np.diag(by_tension.observables.stretch) - 1.0
    strains = {"strain_weft": float(weft), "strain_warp": float(warp)}
    _, by_strain = last_of(scene_of(knit, kind=kind, output={"frames": 3}, load=strains))
    # both within the tolerance of their residuals, and the tension of the first within a third of it
    assert measure.mesh_tension(by_strain.observables) == pytest.approx([1.0, 1.0], rel=2.0 * scene.solver.residual_tolerance)


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_one_direction_by_tension_and_one_by_strain(kind: str) -> None:
    scene = scene_of(kind=kind, load={"tension_warp": "0.5 N/m", "strain_weft": 0.05})
    _, last = last_of(scene)
    assert last.observables.stretch[0, 0] == pytest.approx(1.05, abs=1e-12)
    # multipliers move once more after the check that has found it
    assert measure.mesh_tension(last.observables)[1] == pytest.approx(0.5, rel=TOLERANCE + scene.solver.residual_tolerance)


def test_heat_under_a_held_tension_expands_the_mesh() -> None:
    """Without contact forces that change, by the expansion of the wire; here by some of it, and the tension stays."""
    path = [{"name": "warm", "temperature": "120 degC"}]
    records = list(Simulation(build_model(scene_of(path=path))).run())
    cold, warm = records[-2].observables, records[-1].observables
    assert measure.mesh_tension(warm) == pytest.approx([1.0, 1.0], rel=TOLERANCE)
    assert np.all(np.diag(warm.stretch) > np.diag(cold.stretch))


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_worlds_under_other_tensions_are_single_runs_to_the_bit(kind: str) -> None:
    tensions = ({"tension_weft": f"{tension} N/m", "tension_warp": f"{tension} N/m"} for tension in (0.5, 1.0))
    scenes = [scene_of(kind=kind, load=tension) for tension in tensions]
    last = {record.world: record for record in Simulation(build_model(scenes[0]), worlds=scenes).run()}
    for world, scene in enumerate(scenes):
        _, expected = last_of(scene)
        assert last[world].steps == expected.steps
        assert np.array_equal(last[world].observables.node_position, expected.observables.node_position)


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_an_interrupted_level_goes_on_to_the_same_bits(kind: str) -> None:
    model = build_model(scene_of(kind=kind))

    class Stop(Exception):
        pass

    def run(stop_at: int | None, kept: tuple | None) -> tuple:
        simulation = Simulation(model, progress=Progress.from_dict(kept[1]) if kept else None)
        simulation.compile()
        if kept:
            simulation.drive.load_state_dict(kept[0])
        checks = 0

        def monitor(_progress: Progress) -> None:
            nonlocal checks
            checks += 1
            if checks == stop_at:
                raise Stop

        simulation.monitor = monitor
        try:
            for _ in simulation.run():
                pass
        except Stop:
            pass
        return simulation.drive.state_dict(), simulation.progress.as_dict(), simulation.state.arrays()

    expected = run(None, None)
    found = run(None, run(31, None))
    for name, value in expected[2].items():
        assert np.array_equal(found[2][name], value), name


@pytest.mark.parametrize("kind", [*slow("planar"), "spatial"])
def test_with_friction_the_number_of_levels_matters_little(kind: str) -> None:
    """Strains change by at most 0.5 % from one equilibrium to the next, whatever the levels are."""
    strains = []
    for frames in (1, 2):
        tables = {"contact": {"friction": 0.2}, "load": {"tension_weft": "0.5 N/m", "tension_warp": "0.5 N/m"}}
        _, last = last_of(scene_of(kind=kind, output={"frames": frames}, **tables))
        assert measure.mesh_tension(last.observables) == pytest.approx([0.5, 0.5], rel=TOLERANCE)
        strains.append(np.diag(last.observables.stretch) - 1.0)
    assert strains[1] == pytest.approx(strains[0], abs=0.02 * np.abs(strains[0]).max())


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_a_mesh_that_cannot_carry_its_tension_says_what_it_carried(kind: str) -> None:
    """Pillars side by side are held by nothing in weft."""
    pillars = {"bars": [{"chain": "1-0/0-1"}], "wales": "26 /inch", "courses": "30 /inch"}
    simulation = Simulation(build_model(scene_of(kind=kind, knit=pillars)))
    with pytest.raises(NotCarried, match="0 N/m in weft, 0 N/m in warp"):
        list(simulation.run())
    strain = np.diag(simulation.state.gradient) - 1.0
    assert strain[0] > 5.0 > strain[1]
    assert simulation.progress.steps < 1.1 * 5.0 / 3e-4  # by the largest strain of a step


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_with_friction_a_held_tension_does_not_stop_the_other_one(kind: str) -> None:
    """Weft keeps its tension while that in warp falls to a fifth: strains rest, and both are carried."""
    tables = {"contact": {"friction": 0.2}, "load": {"tension_weft": "0.5 N/m", "tension_warp": "0.5 N/m"}}
    _, last = last_of(scene_of(kind=kind, path=[{"name": "slacker", "tension_warp": "0.1 N/m"}], **tables))
    assert last.stage == "slacker"
    assert measure.mesh_tension(last.observables) == pytest.approx([0.5, 0.1], abs=2.0 * TOLERANCE * 0.5)


def test_a_path_by_tension_is_that_of_its_strains() -> None:
    """With friction, too: strained through the strains of its equilibria, a mesh carries their tensions, to the change of tension
    over 1e-3 of strain. Levels by strain go straight where those by tension need not."""
    tables = {"contact": {"friction": 0.2}}
    records = list(Simulation(build_model(scene_of(output={"frames": 4}, **tables))).run())[1:]
    strains = [np.diag(record.observables.stretch) - 1.0 for record in records]
    stages = [{"name": str(k), "strain_weft": float(x), "strain_warp": float(y)} for k, (x, y) in enumerate(strains)]
    _, last = last_of(scene_of(load=stages[0], path=stages[1:], **tables))
    tensions = [np.array(measure.mesh_tension(record.observables)) for record in records]
    slope = np.linalg.norm(tensions[-1] - tensions[-2]) / np.linalg.norm(strains[-1] - strains[-2])
    assert measure.mesh_tension(last.observables) == pytest.approx(tensions[-1], abs=1e-3 * slope)


def test_the_loop_of_a_cycle_of_tension_is_what_friction_dissipates() -> None:
    """Let back from 1 to 0.3 N/m and loaded again the mesh returns to where it was: it has stored nothing more, and the area of
    the loop is lost. Friction at the end of an increment acts on all of its slip, and work is by the trapezoidal rule."""
    stages = [{"name": str(k), "tension_weft": end, "tension_warp": end} for k, end in enumerate((0.3, 1.0, 0.3, 1.0))]
    model = build_model(scene_of(contact={"friction": 0.2}, path=stages, output={"frames": 4}))
    rows = with_work([row_of(record) for record in Simulation(model).run()], model)
    begin, end = (next(row for row in rows if row.stage == name and row.load_factor == 1.0) for name in ("1", "3"))
    dissipated = end.dissipated_J - begin.dissipated_J
    assert abs(end.stored - begin.stored) < 1e-3 * dissipated
    assert end.work_J - begin.work_J == pytest.approx(dissipated, rel=0.05)
    assert dissipated > 0.05 * end.stored


@pytest.mark.parametrize(("kind", "friction"), [("spatial", 0.0), ("spatial", 0.2), ("planar", 0.0)])
def test_a_slack_mesh_that_is_cooled_shrinks_with_its_wires(kind: str, friction: float) -> None:
    """At no tension all lengths change by alpha (T - T0), also in weft, in which a tricot may strain by 9 % at no force.

    The tensions that a check accepts, 0.01 EI/C^3, change the strain by far more: the mesh is to stay where it was.
    """
    tables = {"contact": {"friction": friction}, "load": {"tension_weft": 0.0, "tension_warp": 0.0}, "output": {"frames": 4}}
    scene = scene_of(kind=kind, **tables, path=[{"temperature": "-100 degC"}], solver={})
    records = list(Simulation(build_model(scene)).run())
    knitted, cooled = records[4], records[-1]
    change = np.diag(cooled.observables.stretch) / np.diag(knitted.observables.stretch) - 1.0
    assert change == pytest.approx(np.full(2, -120.0 * scene.wire.expansion), rel=0.01)


@pytest.mark.parametrize(("strain", "rests"), [(0.005, True), (-0.005, True), (0.004, False)])
def test_while_a_strain_is_at_its_limit_the_other_one_rests(strain: float, rests: bool) -> None:
    """Where a history allows no more strain. Within the limit the other one moves by what its tension lacks."""
    tension, wanted = (0.25, 0.4), (1.0, 2.0)
    mass, damping = 1e6, 0.02
    control = Steering(wp.zeros(CONTROL_COUNT, dtype=wp.float64, device="cpu"))
    stretched = np.diag([1.0 + strain, 1.0])
    control.set(
        gradient=stretched, length_factor=1.0, time_step=1.0, damping=damping, is_driven=1.0, tension_from=0.0,
        tension_to=wanted, strain_mass=mass, strain_limit=1.0, strain_range=0.005, cell_area=1.0, stress_unit=1.0,
        at_limit=(float(rests), 0.0), strain_speed=(0.0, 3e-9), step_limit=1.0, travel_limit=1.0, speed_limit=1.0,
    )  # fmt: skip
    nominal = np.linalg.det(stretched) * np.diag(tension) @ np.linalg.inv(stretched).T
    partial = np.zeros((1, PARTIAL_COUNT))
    partial[0, int(STRESS_PART) : int(STRESS_PART) + 4] = nominal.ravel()
    none = wp.zeros((0, PARTIAL_COUNT), dtype=wp.float64, device="cpu")
    wp.launch(update_control, 1, [wp.array(partial, dtype=wp.float64, device="cpu"), none, control.array], device="cpu")
    np.testing.assert_allclose(control.tension, tension, rtol=1e-12)
    lacking = (wanted[1] - tension[1]) * (1.0 + strain)
    expected = 0.0 if rests else ((1.0 - damping / 2) * 3e-9 + lacking / mass) / (1.0 + damping / 2)
    np.testing.assert_allclose(control.strain_speed[1], expected, rtol=1e-12, atol=1e-22)
