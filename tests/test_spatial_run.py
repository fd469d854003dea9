"""Runs of the spatial model: what it refuses, and what it leaves."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from reference.in_words import in_words, quantities
from reference.interrupted import assert_parts_are_the_whole
from warpknit import load_run, measure
from warpknit.base.errors import SceneError
from warpknit.commands.cli import main
from warpknit.compute.host import fetch, store
from warpknit.mechanics.driven_strain import TOLERANCE
from warpknit.results.frame import Frame, WireLayout, curve_position, drawn_frame, drawn_layout
from warpknit.results.row import Row
from warpknit.runner import warnings_of as of_result
from warpknit.runner.history import row_of
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.relax import Relaxation
from warpknit.solve.simulate import Simulation

SCENES = Path(__file__).parent.parent / "scenes"
CELL = SCENES / "atlas_cell_spatial.toml"
QUICK = ("model.nodes_per_loop=24", "solver.preset=draft", "output.frames=1", "load.strain_weft=0.01", "load.strain_warp=0.01")


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("solver.multipliers=false", "solver.multipliers: "),
        ("contact.body_mass=0.1", "contact.body_mass: 0.1"),
    ],
)
def test_what_only_the_planar_model_does_is_refused(override: str, line: str) -> None:
    with pytest.raises(SceneError) as error:
        load_scene(CELL, [override])
    assert line in str(error.value) and "model.kind = 'spatial'" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("spatial") / "run"
    assert run_scene(load_scene(CELL, QUICK), out=out, device="cpu").exit_code == 0
    return out


def test_loops_set_in_part_spring_open_step_by_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To 0.9 of their curvature in five equilibria before the first record, which at once diverge. The first record has the
    natural curvature of the whole step, and an interruption on the way changes nothing."""
    scene = load_scene(CELL, [*QUICK, "wire.set_fraction=0.9", "model.nodes_per_loop=20"])
    simulation = Simulation(build_model(scene))
    natural = simulation.mechanics.stepper.arrays.natural_curvature
    whole, found, solve = natural.numpy().copy(), [], Relaxation.reach

    def noted(self, *arguments):
        found.append(float(np.linalg.norm(natural.numpy()) / np.linalg.norm(whole)))
        return solve(self, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Relaxation, "reach", noted)
        first = next(simulation.run())
    assert found == pytest.approx([share / 0.9 for share in (0.98, 0.96, 0.94, 0.92, 0.9)])
    assert natural.numpy() == pytest.approx(whole, rel=1e-12) and first.observables.energies.stored > 0.0
    assert_parts_are_the_whole(scene, tmp_path, monkeypatch, every=53)


@pytest.mark.parametrize(
    ("fraction", "factor", "cause"),
    [(0.5, 0.0, "wire.set_fraction"), (0.5, 0.1, "output.frames"), (1.0, 0.0, "change the shape of the wires")],
)
def test_a_divergence_names_its_cause(fraction: float, factor: float, cause: str) -> None:
    """Before any load that is the natural curvature, where it is not that as knitted."""
    simulation = Simulation(build_model(load_scene(CELL, [*QUICK, f"wire.set_fraction={fraction}"])))
    simulation.progress.load_factor = factor
    assert cause in str(simulation.drive.divergence())


@pytest.mark.parametrize("given", [(), ("contact.stiffness=40 N/m",)])
def test_wires_in_each_other_are_told_with_place_and_stiffness(given: tuple[str, ...]) -> None:
    """One wire of the cell lowered by its thickness. In the dynamics it is as stiff as the loops, as is a penalty that is not
    given."""
    simulation = Simulation(build_model(load_scene(CELL, [*QUICK, *given])))
    mechanics, rods = simulation.mechanics, simulation.model.rods
    lowered = fetch(mechanics.state.displacement).copy()
    lowered[rods.wire_of == 0, 2] -= rods.section.thickness
    store(mechanics.state.displacement, lowered)
    mechanics.contact.search()
    mechanics.stepper.evaluate()
    line = str(simulation.drive.overlap_error(mechanics.overlap()))
    place = re.search(r"near \(([^,]+), ([^)]+)\) (\w+) from the corner", line)
    assert place is not None
    x, y = (float(text) * {"um": 1e-3, "mm": 1.0}[place[3]] for text in place.groups()[:2])
    assert {"0", "1"} <= set(quantities(line)) and "\n" not in line
    for wire in (0, 1):
        away = 1e3 * rods.position[rods.wire_of == wire, :2] - (x, y)
        away -= 1e3 * rods.tile[:2] * np.round(away / (1e3 * rods.tile[:2]))
        assert np.linalg.norm(away, axis=1).min() < 1e3 * rods.node_length.max()
    assert {"14.2 mN", "70.7 N"} <= set(quantities(line))
    assert ({"6.03 N/m", "333 N/m"} <= set(quantities(line))) == (not given)


def keys_of(tree: dict, under: str = "") -> set[str]:
    found = set()
    for key, value in tree.items():
        found.add(f"{under}{key}")
        if isinstance(value, dict):
            found |= keys_of(value, f"{under}{key}.")
    return found


def test_summary_has_the_keys_of_a_planar_run(finished: Path, tmp_path: Path) -> None:
    planar = run_scene(load_scene(SCENES / "atlas_cell.toml", QUICK), out=tmp_path / "planar", device="cpu").summary.json()
    summary = json.loads((finished / "summary.json").read_text())
    assert summary["model"]["kind"] == "spatial" and summary["stop_reason"] == "steady"
    assert keys_of(planar) <= keys_of(summary)
    assert {"near_percent", "elsewhere"} <= summary["contacts"].keys()
    for name in ("wires", "bodies", "pairs", "repeats"):
        assert summary["model"][name] == planar["model"][name]


def test_states_are_in_space_and_whole(finished: Path) -> None:
    layout = WireLayout.load(finished / "layout.npz")
    first, last = (Frame.load(finished / "states" / f"state_{k:06d}.npz") for k in (0, 1))
    last.require_layout(layout)
    assert np.ptp(first.node_position[:, 2]) > layout.diameter
    assert np.abs(last.node_position[:, 2] - first.node_position[:, 2]).max() > 1e-9
    assert last.strain_weft == pytest.approx(0.01)
    assert (finished / "scene.usda").exists() and (finished / "figures" / "mesh.png").exists()


def test_contacts_elsewhere_of_a_tight_knit_have_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tricot, with interruptions: in each record as many as the history says, up to its largest force. Where two wires touch
    the place is half a thickness from the drawn curves of both, but for the height of an arc above the pieces of a curve."""
    knit = {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"}
    table = {"wire": {"material": "molybdenum", "diameter": 30e-6}, "knit": knit, "solver": {"preset": "draft"}}
    table |= {"contact": {"friction": 0.0}, "variants": {"count": 1}}
    table |= {"model": {"kind": "spatial", "boundary": "periodic"}, "load": {"strain_weft": 0.06, "strain_warp": 0.06}}
    scene = load_scene(table | {"output": {"frames": 6, "figures": False, "usd": False}})
    run = load_run(assert_parts_are_the_whole(scene, tmp_path, monkeypatch, every=23))
    layout, states = drawn_layout(run.layout), list(run.states)
    assert [len(state.elsewhere_force) for state in states] == run.history["contacts_elsewhere"].tolist()
    largest = [state.elsewhere_force.max(initial=0.0) for state in states]
    assert largest == run.history["elsewhere_force_max_N"].tolist() and largest[0] == 0.0 < largest[-1]
    last = states[-1]
    points, tile = curve_position(layout, drawn_frame(run.layout, last)), last.deformation @ np.diag(layout.period)
    images = [np.append(tile @ [i, j], 0.0) for i in range(-3, 4) for j in range(-3, 4)]
    for place, wires in zip(last.elsewhere_position, last.elsewhere_wires, strict=True):
        for wire in wires:
            curve = points[layout.curve_start[wire] : layout.curve_start[wire + 1]]
            edge, away = np.diff(curve, axis=0), place + np.array(images)[:, None] - curve[:-1]
            share = np.clip(np.sum(away * edge, axis=2) / np.sum(edge**2, axis=1), 0.0, 1.0)
            distance = np.linalg.norm(away - share[:, :, None] * edge, axis=2).min()
            assert distance == pytest.approx(0.5 * layout.diameter, rel=0.1)


def test_a_compressed_mesh_is_not_warned_of_the_plane() -> None:
    """What wrinkles is said to be too small here, and not to be planar."""
    relaxation = Simulation(build_model(load_scene(CELL, QUICK)))
    row = Row(**vars(row_of(next(relaxation.run()))) | {"strain_weft": -0.02})
    [warning] = [line for line in in_words(of_result.warnings_of)(relaxation.model, [row]) if "compressed" in line]
    assert "planar" not in warning


@pytest.mark.parametrize(("weft", "says"), [(-0.02, False), (-0.05, True)])
def test_a_mesh_that_pushes_is_named(weft: float, says: bool) -> None:
    """A direction that is held, by a tension below that of the residual; scatter without load is not."""
    relaxation = Simulation(build_model(load_scene(CELL, QUICK)))
    values = vars(row_of(next(relaxation.run())))
    tensions = [(1e-9, -1e-9), (weft, 1.0)]
    rows = [Row(**values | {"tension_weft_N_per_m": one, "tension_warp_N_per_m": other}) for one, other in tensions]
    found = [line for line in in_words(of_result.warnings_of)(relaxation.model, rows) if "pushes along weft" in line]
    assert bool(found) == says


@pytest.mark.parametrize("more", [["model.boundary=gripped", "knit.repeats=[2, 2]"], ["contact.friction=0.2"]])
def test_the_stress_of_the_checks_is_that_of_the_records(more: list[str]) -> None:
    """Kernels on the device, and the sum over the record on the host: to the round-off of sums of thousands of nodes."""
    relaxation = Simulation(build_model(load_scene(CELL, [*QUICK, *more])))
    *_, record = relaxation.run()
    expected = record.observables.nominal_stress
    assert relaxation.mechanics.stress() == pytest.approx(expected, rel=0, abs=1e-10 * np.abs(expected).max())


def test_an_error_is_not_promised_of_wires_from_a_file(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as end:
        main(["run", str(SCENES / "wires" / "plain_knit_cell.toml"), "--error", "2", "--quiet"])
    assert end.value.code == 2
    assert "wires: " in capsys.readouterr().err


def test_tension_is_found_and_let_go_again() -> None:
    """Warp by tension, there and back to none, weft held: to the 0.2 % that the search allows, or 1e-2 of that of EI/C^3."""
    path = ["load.strain_weft=0.0", "load.tension_warp='3 mN/m'", "path=[{tension_warp='1 mN/m', strain_weft=0.005}]"]
    coarse = [o for o in QUICK if not o.startswith("load")]
    relaxation = Simulation(build_model(load_scene(CELL, [*coarse, *path])))
    _, loaded, unloaded = relaxation.run()
    for record, warp, weft in ((loaded, 3e-3, 0.0), (unloaded, 1e-3, 0.005)):
        least = 1e-2 * TOLERANCE * measure.tension_scale(relaxation.model)
        assert measure.mesh_tension(record.observables)[1] == pytest.approx(warp, rel=TOLERANCE, abs=least)
        assert record.observables.gradient[0, 0] == 1.0 + weft
    assert loaded.observables.gradient[1, 1] > unloaded.observables.gradient[1, 1] > 1.0


@pytest.mark.slow
def test_single_precision_resumes_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene(CELL, [*QUICK, "solver.precision=single", "output.frames=2"])
    assert_parts_are_the_whole(scene, tmp_path, monkeypatch, 17)


HOOK = ("model.nodes_per_loop=16", "hook.overlap='60 um'", "solver.residual_tolerance=2e-2", "output.frames=1")


@pytest.mark.parametrize(
    ("path", "every"), [((), 13), (("contact.friction=0.3", "wire.plastic=true", "wire.yield_stress='50 MPa'"), 41)]
)
def test_interrupt_and_resume_give_the_same_bits(
    tmp_path: Path, path: tuple[str, ...], every: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Clamps that slide, contacts that stick, wires that yield, a list of pairs in use and a stage that returns: all goes on as
    if nothing had been."""
    load = ("load.displacement='80 um'", "path=[{displacement='75 um'}]", *path)
    scene = load_scene(SCENES / "hook_spatial.toml", [*HOOK, *load])
    parts = assert_parts_are_the_whole(scene, tmp_path, monkeypatch, every)
    assert json.loads((parts / "summary.json").read_text())["hook"]["force_left_N"] > 0.0


def test_a_finished_run_is_not_replaced_unasked(finished: Path) -> None:
    with pytest.raises(Exception, match="--force"):
        run_scene(load_scene(CELL, QUICK), out=finished, device="cpu")


def test_contacts_store_no_negative_energy() -> None:
    """A contact of force N = k (g + o), overlap g and offset o stores k g^2/2 >= 0, at most N |g|/2 where it overlaps. N g/2, of
    a contact that pushes over a gap g < 0, is negative."""
    bars = [{"chain": "2-3/1-0"}, {"chain": "1-0/1-2"}]
    locknit = {
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": bars, "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"kind": "spatial", "boundary": "periodic"},
        "contact": {"friction": 0.0},
        "variants": {"count": 1},
        "load": {"strain_weft": 0.045, "strain_warp": 0.045},
        "solver": {"preset": "draft"},
        "output": {"frames": 9},
    }
    last = [record.observables for record in Simulation(build_model(load_scene(locknit))).run()][-1]
    pressed = last.touching.force * last.touching.overlap
    assert last.touching.force.size and pressed.sum() < 0.0
    assert 0.0 <= last.energies.contact <= 0.5 * np.abs(pressed).sum()
