"""Worlds of a batch answer as single runs do, and no world depends on the others."""

from dataclasses import replace

import numpy as np
import pytest

from reference.cases import slow
from reference.in_words import quantities
from warpknit.base.errors import Diverged
from warpknit.measure import mesh_tension
from warpknit.measure.table import Record
from warpknit.planar.state import initial_state
from warpknit.scene import Scene, load_scene, make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.solve.variant_models import VariantModels
from warpknit.studies.load_path import ends_of, knitted_worlds

STRAINS = [(0.1, 0.1), (0.0, 0.16), (0.16, 0.02), (0.04, 0.0)]


def scene_of(boundary: str, **tables: dict) -> Scene:
    repeats = [1, 1] if boundary == "periodic" else [2, 2]
    return make_scene(
        {
            "knit": {"repeats": repeats},
            "model": {"kind": "planar", "boundary": boundary},
            "solver": {"preset": "draft"},
            "output": {"frames": 4},
        }
        | tables
    )


def stages(scene: Scene, strains: list[tuple[float, float]]) -> list:
    return [[replace(scene.stages[0], strain_weft=x, strain_warp=y)] for x, y in strains]


def ends(scene: Scene, strains: list[tuple[float, float]]) -> list[Record | Diverged]:
    count = len(strains)
    simulation = knitted_worlds([build_model(scene)] * count, stages(scene, strains), [scene.output.levels] * count)
    found = dict(ends_of(simulation))
    return [found[k] for k in range(count)]


@pytest.mark.parametrize(
    ("boundary", "tables", "strains"),
    [
        ("periodic", {}, STRAINS),
        *slow(("gripped", {}, STRAINS)),
        ("gripped", {"wire": {"plastic": True, "yield_stress": "60 MPa"}, "contact": {"friction": 0.2}}, STRAINS[::3]),
    ],
)
def test_each_world_answers_as_a_run_of_its_load(boundary, tables, strains):
    """The same steps, checks and decisions, to the bit; also of worlds that are stepped one after the other."""
    scene = scene_of(boundary, **tables)
    scenes = [replace(scene, stages=tuple(own)) for own in stages(scene, strains)]
    outcomes = {record.world: record for record in Simulation(build_model(scene), worlds=scenes).run()}
    for world, single in enumerate(scenes):
        outcome, model = outcomes[world], build_model(single)
        *_, last = Simulation(model, initial_state(model)).run()
        assert outcome.steps == last.steps
        for name in ("u", "body_u", "pair_force", "tension"):
            assert np.array_equal(getattr(outcome.observables, name), getattr(last.observables, name)), name


def test_a_world_does_not_depend_on_its_batch():
    """To the bit: alone, among others, and in another place."""
    scene = scene_of("periodic")
    alone = ends(scene, STRAINS[:1])[0]
    among = ends(scene, STRAINS[::-1])[-1]
    assert alone.steps == among.steps
    assert np.array_equal(alone.observables.u, among.observables.u)
    assert np.array_equal(alone.observables.pair_force, among.observables.pair_force)


def test_a_world_that_fails_leaves_the_others_alone():
    """A level that may take no more than 600 steps is too short for a load."""
    scene = scene_of("periodic", solver={"preset": "draft", "max_steps": 600})
    found = ends(scene, [(0.0, 0.0), (0.16, 0.0)])
    assert isinstance(found[0], Record)
    assert isinstance(found[1], Diverged) and "600" in quantities(str(found[1]))


def test_a_mesh_of_scattered_loops_does_not_depend_on_those_beside_it():
    """Meshes of one repeat with friction, some of them under another load: to the bit, whatever their number and order."""
    scene = load_scene({
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"boundary": "periodic"},
        "load": {"strain_weft": 0.05, "strain_warp": 0.05},
        "solver": {"preset": "draft"},
        "variants": {"count": 4, "scatter": 0.1},
    })  # fmt: skip
    models, stage = VariantModels(scene), scene.stages[0]
    found = []
    for meshes in ([2], [1, 2, 0, 3]):
        worlds = knitted_worlds([models.of_place(mesh) for mesh in meshes], [[stage]] * len(meshes), [2] * len(meshes))
        own = dict(ends_of(worlds))[meshes.index(2)]
        found.append((own.steps, own.observables.node_position.tobytes()))
    assert found[0] == found[1]


def test_levels_without_records_do_not_wait_for_the_drift_of_the_tension():
    """Worlds that record the end only take fewer steps, to tensions within the residual tolerance."""
    scene = scene_of("periodic")
    scenes = [replace(scene, stages=tuple(own)) for own in stages(scene, STRAINS[:1])]
    *_, every = Simulation(build_model(scene), worlds=scenes).run()
    (end,) = Simulation(build_model(scene), worlds=scenes, ends_only=True).run()
    assert end.steps < every.steps
    tensions = (np.array(mesh_tension(record.observables)) for record in (end, every))
    assert np.allclose(*tensions, rtol=0.0, atol=scene.solver.residual_tolerance * max(mesh_tension(every.observables)))
