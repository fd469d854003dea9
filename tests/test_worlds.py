"""Worlds of a simulation answer as single runs do."""

from dataclasses import replace

import numpy as np
import pytest

from warpknit import Simulation, build_model, load_scene, measure
from warpknit.base.errors import InputError
from warpknit.scene import Scene

TRICOT = {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"}


def scene_of(kind: str, strain: float = 0.02, **knit: object) -> Scene:
    return load_scene(
        {
            "wire": {"material": "molybdenum", "diameter": "30 um"},
            "knit": TRICOT | knit,
            "model": {"kind": kind, "boundary": "periodic"},
            "contact": {"friction": 0.0},
            "load": {"strain_weft": strain, "strain_warp": strain},
            "solver": {"preset": "draft"},
            "output": {"frames": 2},
        }
    )


def single(scene: Scene) -> list:
    return list(Simulation(build_model(scene)).run())


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_worlds_of_other_loads_are_single_runs_to_the_bit(kind: str) -> None:
    scenes = [scene_of(kind, strain) for strain in (0.01, 0.03, 0.02)]
    records = list(Simulation(build_model(scenes[0]), worlds=scenes).run())
    assert sorted(record.world for record in records) == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    for world, scene in enumerate(scenes):
        own = [record for record in records if record.world == world]
        for found, expected in zip(own, single(scene), strict=True):
            assert (found.load_factor, found.steps) == (expected.load_factor, expected.steps)
            assert np.array_equal(found.observables.node_position, expected.observables.node_position)


def test_worlds_of_other_seeds_have_their_own_loops() -> None:
    scenes = [scene_of("spatial", scatter=0.02, seed=seed) for seed in (1, 2)]
    last = {record.world: record for record in Simulation(build_model(scenes[0]), worlds=scenes).run()}
    for world, scene in enumerate(scenes):
        expected = np.array(measure.mesh_tension(single(scene)[-1].observables))
        # masses and search radii are made for the loops of all worlds: equilibria agree within their tolerance
        found = np.array(measure.mesh_tension(last[world].observables))
        assert found == pytest.approx(expected, rel=0.0, abs=scene.solver.residual_tolerance * np.abs(expected).max())
    assert measure.mesh_tension(last[0].observables) != measure.mesh_tension(last[1].observables)


def test_worlds_of_other_friction_are_single_runs_to_the_bit() -> None:
    scenes = [load_scene(scene_of("spatial"), [f"contact.friction={friction}"]) for friction in (0.1, 0.3)]
    last = {record.world: record for record in Simulation(build_model(scenes[0]), worlds=scenes).run()}
    for world, scene in enumerate(scenes):
        expected = single(scene)[-1]
        assert last[world].steps == expected.steps
        assert np.array_equal(last[world].observables.node_position, expected.observables.node_position)


def test_a_world_that_fails_is_left_out() -> None:
    base = scene_of("planar")
    solver = replace(base.solver, max_steps=600)
    scenes = [
        replace(base, solver=solver, stages=(replace(base.stages[0], strain_weft=x, strain_warp=0.0),)) for x in (0.0, 0.16)
    ]
    simulation = Simulation(build_model(scenes[0]), worlds=scenes)
    assert {record.world for record in simulation.run() if record.load_factor == 1.0} == {0}
    assert list(simulation.failures) == [1]


def test_worlds_of_another_wire_are_refused() -> None:
    other = load_scene(scene_of("spatial"), ["wire.diameter=20 um"])
    with pytest.raises(InputError, match=r"world 1 .*\[wire\]"):
        Simulation(build_model(scene_of("spatial")), worlds=[scene_of("spatial"), other])
