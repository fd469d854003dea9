"""Ramps in space, real time and real masses: what the boundary does is on the books, the end is the state at rest, and a run that
was cut short goes on to the same bits.

    work of the boundary and of heat = stored + kinetic energy + what the damping took, to the order of the step
"""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from reference.cases import slow
from reference.interrupted import assert_parts_are_the_whole
from warpknit import measure
from warpknit.base.errors import Diverged
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Record, Simulation
from warpknit.spatial.step_bound import TWIST_SHARE

SCENES = Path(__file__).parents[2] / "scenes"
CELL = SCENES / "atlas_cell_spatial.toml"
RAMP = ("solver.preset=draft", "solver.drive=ramp", "output.usd=false", "output.figures=false")
HEATED = ("wire.expansion='4.5e-5 /K'", "load.temperature='120 degC'", "load.shear=0.05", "load.strain_weft=0.03")
GRIPPED = ("model.boundary=gripped", "knit.repeats=[1,2]", "model.nodes_per_loop=24", "solver.residual_tolerance=0.02")
PATCH = (*RAMP, *HEATED, *GRIPPED)


def missing(record: Record) -> float:
    """What is not on the books, over the work."""
    r = record.observables
    return (record.work - r.energies.stored - r.kinetic_energy - record.dissipated) / record.work


def test_a_patch_that_is_pulled_sheared_and_heated_keeps_its_books() -> None:
    """Clamps that move, contacts that close, wires that grow: the leapfrog keeps energy to second order of the step, and the work
    is by the trapezoidal rule over looks of 50 steps: 1e-3 of it."""
    load = ("load.strain_warp=0.03", "solver.loading_time='1 ms'", "output.frames=4")
    first, *records = Simulation(build_model(load_scene(CELL, [*PATCH, *load]))).run()
    assert first.work < 1e-30
    assert len(records) == 4 and records[-1].steady
    assert records[1].observables.kinetic_energy > 1e-3 * records[1].work  # it moves
    assert records[-1].dissipated > 0.05 * records[-1].work
    assert len(records[-1].observables.touching.force) > 2
    assert max(abs(missing(record)) for record in records) < 1e-3


def test_what_friction_takes_is_on_the_books() -> None:
    """A twentieth of the work; what is left of the balance is what sticking contacts store, which lose it as they part."""
    load = ("load.strain_weft=0.12", "load.strain_warp=0.12", "solver.loading_time='8 ms'", "output.frames=2")
    options = ["model.nodes_per_loop=24", "solver.residual_tolerance=0.02", "contact.friction=0.3", *load]
    simulation = Simulation(build_model(load_scene(CELL, [*RAMP, *options])))
    *_, last = simulation.run()
    assert simulation.mechanics.dissipated > 0.04 * last.work
    assert abs(missing(last)) < 0.01


def test_a_load_that_is_too_fast_says_which_key_makes_it_slower() -> None:
    """Over in a microsecond: nodes move farther than half a wire in one step before any can pass another unseen."""
    load = ("load.strain_weft=0.5", "load.strain_warp=0.5", "solver.loading_time='1 us'", "output.frames=1")
    with pytest.raises(Diverged, match=r"solver\.loading_time"):
        list(Simulation(build_model(load_scene(CELL, [*RAMP, "model.nodes_per_loop=24", *load]))).run())


@pytest.mark.slow
def test_a_ramp_ends_where_a_relaxation_does() -> None:
    """Within the tolerance of both, and what the softening s leaves of the bending of arcs, s (d/4R)^2, R about half a course."""
    load = ("load.strain_weft=0.05", "load.strain_warp=0.05", "model.nodes_per_loop=40", "output.frames=1", RAMP[0])
    ends = [
        [*drive(build_model(load_scene(CELL, [*load, *more]))).run()][-1].observables
        for drive, more in (
            (Simulation, ("solver.drive=ramp", "solver.loading_time='5 ms'", "solver.axial_softening=50")),
            (Simulation, ()),
        )
    ]
    ramped, relaxed = map(measure.mesh_tension, ends)
    assert ramped == pytest.approx(relaxed, rel=0.02, abs=0.02 * max(relaxed))
    assert ends[0].energies.stored == pytest.approx(ends[1].energies.stored, rel=0.01, abs=0)


def test_masses_make_the_wanted_step_stable() -> None:
    """The step is the one asked for or a little more, and twist never rules it."""
    for wanted, scaling in ((2e-6, 1.0), (None, 1.0), (None, 1e4)):
        options = [] if wanted is None else [f"solver.target_time_step={wanted}"]
        numbers = build_model(load_scene(CELL, [*RAMP, *options, f"solver.mass_scaling={scaling}"]))
        assert numbers.ramp.rates["twist"] <= 1.01 * TWIST_SHARE * numbers.ramp.rates["all"]
        if wanted is None:
            assert numbers.added_mass == pytest.approx(scaling - 1.0, rel=1e-9, abs=1e-12)
        else:
            assert wanted <= numbers.time_step < 1.3 * wanted
            assert numbers.added_mass > 1.0


@pytest.mark.parametrize("friction", [*slow(0.0), 0.3])
def test_interrupt_and_resume_give_the_same_bits(friction: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A load that comes on, contact lists, work and damping: all goes on as if nothing had been."""
    load = ("load.strain_warp=0.02", "solver.loading_time='0.05 ms'", "output.frames=2", "solver.damping='1e5 /s'")
    scene = load_scene(CELL, [*PATCH, *load, f"contact.friction={friction}", "path=[{temperature='20 degC', shear=0}]"])
    parts = assert_parts_are_the_whole(scene, tmp_path, monkeypatch, every=17)
    with open(parts / "history.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5 and float(rows[-1]["dissipated_J"]) > 0.0
    summary = json.loads((parts / "summary.json").read_text())
    assert summary["solver"]["drive"] == "ramp" and summary["solver"]["time_step_s"] < 1e-5
    assert abs(summary["quality"]["energy_balance"]) < 0.015
    assert any("kinetic energy reached" in line for line in summary["warnings"])


@pytest.mark.slow
def test_a_ramp_finds_the_strains_that_carry_a_tension() -> None:
    """A patch pulled by tension alone in real time: carried at rest to the 0.5 % of the stage's end, or 5e-5 EI/C^3."""
    load = (*RAMP, *GRIPPED, "load.tension_weft='5 mN/m'", "load.tension_warp='10 mN/m'", "solver.loading_time='8 ms'")
    *_, last = Simulation(build_model(load_scene(CELL, [*load, "output.frames=1"]))).run()
    assert last.steady
    assert measure.mesh_tension(last.observables) == pytest.approx((5e-3, 1e-2), abs=5.1e-5)
