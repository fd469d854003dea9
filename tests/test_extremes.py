"""Scenes far from the usual end in a finite answer with true warnings, or with exit status 2 or 3 and one line that says why.

The space is that of tools/studies/extremes.py, whose table says what each corner of it ends in. Draws are the same on every run.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import Phase, event, given, settings
from hypothesis import strategies as st

from warpknit.base.errors import WarpknitError
from warpknit.knit.lapping import KnitError
from warpknit.runner.run import run_scene
from warpknit.runner.run_directory import CommandResult
from warpknit.scene import make_scene

Table = dict[str, dict[str, Any]]
BASE: Table = {
    "load": {"strain_weft": 0.14, "strain_warp": 0.14},
    "model": {"kind": "planar", "boundary": "periodic"},
    "solver": {"preset": "draft", "residual_tolerance": 3e-3},
    "output": {"frames": 2, "usd": False, "figures": False},
}
NODES = st.sampled_from([4, 8, 9, 10, 11, 12, 14, 16, 20])
SOFT, STIFF = 10e9, 600e9  # [Pa] metals lie between


def run_of(table: Table) -> CommandResult:
    """Run a scene as the command line would."""
    with tempfile.TemporaryDirectory() as folder:
        return run_scene(make_scene(table), out=Path(folder) / "run")


def merged(*tables: Table) -> Table:
    return {name: {k: v for t in tables for k, v in t.get(name, {}).items()} for t in tables for name in t}


def power(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers from 10^low to 10^high, evenly in their logarithm."""
    return st.floats(low, high).map(lambda x: 10.0**x)


@st.composite
def scenes(draw: st.DrawFn) -> Table:
    """Any wire from 1 um to 1 mm in any mesh, loaded in any way."""
    diameter = draw(power(-6.0, -3.0))
    course = diameter * draw(power(0.4, 3.0))
    table: Table = {
        "wire": {"youngs_modulus": draw(power(6.0, 12.0)), "density": draw(power(1.0, 5.0)), "diameter": diameter},
        "knit": {
            "wale_spacing": course * draw(st.floats(1.2, 2.0)), "course_spacing": course,
            "repeats": [draw(st.integers(1, 2)), draw(st.integers(1, 2))],
        },
        "model": {"boundary": draw(st.sampled_from(["periodic", "gripped"])), "nodes_per_loop": draw(NODES)},
        "load": {
            "strain_weft": draw(st.floats(-0.2, 1.0)), "strain_warp": draw(st.floats(-0.2, 1.0)),
            "shear": draw(st.sampled_from([0.0, 0.0, 0.3, -0.3])), "temperature": draw(st.floats(4.0, 1500.0)),
        },
    }  # fmt: skip
    if draw(st.booleans()):
        table["contact"] = {"friction": draw(st.sampled_from([0.0, 0.0, 0.3, 5.0]))}
        table["solver"] = {"max_steps": 10_000}
        if table["model"]["boundary"] == "gripped":
            table["load"]["clamp_rotation"] = draw(st.sampled_from([0.0, 0.0, 0.5, -1.5]))
    else:
        rate = math.sqrt(table["wire"]["youngs_modulus"] / table["wire"]["density"]) * diameter / course**2
        table["solver"] = {
            "drive": "ramp", "mass_scaling": draw(power(0.0, 10.0)), "axial_softening": 1000.0,
            "loading_time": draw(power(-1.0, 1.0)) / rate,
        }  # fmt: skip
        table["solver"]["loading_time"] *= math.sqrt(table["solver"]["mass_scaling"])
    return merged(BASE, table)


def numbers(value: Any) -> Iterator[float]:
    """All numbers of a summary."""
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from numbers(item)
    elif isinstance(value, int | float):
        yield float(value)


DRAWS: dict[str, Any] = {"deadline": None, "derandomize": True, "database": None, "phases": [Phase.generate]}


@settings(max_examples=8, **DRAWS)
@given(scenes())
def test_any_scene_ends_well(table: Table) -> None:
    """No other exception than a refusal, no number that is not finite, and the warnings that what was asked for calls for."""
    try:
        found = run_of(table)
    except (WarpknitError, KnitError) as error:
        assert str(error) and "\n" not in str(error)
        assert isinstance(error, KnitError) or error.exit_code in (2, 3)
        event("refused")
        return
    assert found.exit_code in (0, 3)
    event(found.summary.json()["stop_reason"])
    assert all(map(math.isfinite, numbers(found.summary.json())))
    if found.exit_code == 3:
        assert found.message and "\n" not in found.message
        return
    summary, warnings = found.summary.json(), " / ".join(found.summary.json()["warnings"])
    said = {warning[:3] for warning in found.summary.json()["warnings"]}
    stiffness = table["wire"]["youngs_modulus"]
    load = table["load"]
    assert ("wire.youngs_modulus =" in warnings) == (not SOFT <= stiffness <= STIFF)
    if min(load["strain_weft"], load["strain_warp"]) < -0.005:
        assert {"W06", "W07"} & said
    else:  # a mesh that is held may push
        assert "W06" not in said
    assert ("W04" in said) == (summary["wire"]["stress_max_so_far_Pa"] > summary["wire"]["yield_stress_Pa"])
    assert ("W31" in said) == (not 70.0 <= load["temperature"] <= 600.0)
    assert ("W34" in said) == (summary["stop_reason"] == "finished")


def test_a_strain_at_the_limit_is_not_compression() -> None:
    """-0.5 % of a mesh whose grips are turned, whose strain is read with round-off."""
    table: Table = {
        "load": {"strain_weft": 0.27275892828694037, "strain_warp": -0.005, "clamp_rotation": 0.5},
        "model": {"kind": "planar", "boundary": "gripped", "nodes_per_loop": 20},
        "solver": {"preset": "draft", "residual_tolerance": 0.003, "max_steps": 10000},
        "output": {"frames": 2, "usd": False, "figures": False},
        "wire": {"diameter": 1.558579007631804e-05},
        "knit": {"wale_spacing": 0.00689013555528354, "course_spacing": 0.004525922582806832, "repeats": [1, 1]},
    }
    found = run_of(table)
    assert found.exit_code == 0
    assert "W06" not in {warning[:3] for warning in found.summary.json()["warnings"]}


@cache
def tension_of_base() -> tuple[float, float]:
    return scaled_tension(BASE)


def scaled_tension(table: Table) -> tuple[float, float]:
    """T C^3/EI in weft and warp."""
    scene = make_scene(table)
    mesh = run_of(table).summary.json()["mesh"]
    unit = scene.wire.bending_stiffness / scene.knit.course_spacing**3
    return mesh["tension_weft_N_per_m"] / unit, mesh["tension_warp_N_per_m"] / unit


@settings(max_examples=4, **DRAWS)
@given(power(-6.0, -3.0), power(6.0, 12.0), power(1.0, 5.0))
def test_similar_meshes_have_one_answer(diameter: float, stiffness: float, density: float) -> None:
    """T = EI/L^3 g(strain, d/L), to twice the residual tolerance."""
    scale = diameter / 15e-6
    wire = {"diameter": diameter, "youngs_modulus": stiffness, "density": density}
    table = merged(BASE, {"wire": wire, "knit": {"wale_spacing": 1.7e-3 * scale, "course_spacing": 1e-3 * scale}})
    assert scaled_tension(table) == pytest.approx(tension_of_base(), rel=6e-3, abs=0)


def test_a_mesh_of_many_repeats_is_as_one() -> None:
    """A periodic tile of 16 x 2 repeats carries what one repeat does, to twice the residual tolerance."""
    table = merged(BASE, {"knit": {"repeats": [16, 2]}})
    assert scaled_tension(table) == pytest.approx(tension_of_base(), rel=6e-3, abs=0)


def test_a_thin_wire_is_computed_in_double_precision() -> None:
    """Where round-off of float32, EA/s 6e-8, is near the forces, EI/W^2; what is asked for by name is done, and said."""
    thin = merged(BASE, {"wire": {"diameter": 1e-6}})
    assert make_scene(thin).solver.precision == "double"
    assert make_scene(BASE).solver.precision == "single"
    with_single = merged(thin, {"solver": {"precision": "single", "max_steps": 1000}})
    found = run_of(with_single)
    assert found.exit_code == 3
    assert "single precision" in found.message
