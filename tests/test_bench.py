"""The benchmark of a GPU, small and on an emulated one: it says what it measured, and keeps to its time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SMALL = ("knit.repeats=[2, 2]", "solver.preset=draft", "load.strain_weft=0.01", "load.strain_warp=0.01")


@pytest.mark.slow
def test_a_gpu_is_measured_in_one_command(tmp_path: Path) -> None:
    """Steps of both models by graphs and by launches, in contact and free, then both scenes with their parts; a size for which
    there is no time is left out and named."""
    result = tmp_path / "found.json"
    command = [
        sys.executable,
        "-c",
        "import reference.emulated_device, bench; bench.main()",
        "--device",
        "cuda:0",
        "--rounds",
        "1",
    ]
    command += ["--nodes", "300", "1e9", "--minutes", "9", "--json", str(result)]
    for setting in SMALL:
        command += ["--set", setting]
    paths = os.pathsep.join(str(ROOT / folder) for folder in ("tests", "tools"))
    said = subprocess.run(command, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr[-4000:]
    copy, *found = json.loads(result.read_text())
    assert copy["copy_bytes_per_s"] > 0.0
    steps = {one["case"]: one for one in found if "step_us" in one}
    ways = [f"{load}, {way}" for load in ("in contact", "free") for way in ("graph", "launches")]
    assert set(steps) == {f"{kind}, {way}" for kind in ("planar", "spatial") for way in ways}
    for one in steps.values():
        share = one["bytes_a_node_step"] * one["node_steps_per_s"] / copy["copy_bytes_per_s"]
        assert one["share_of_copy"] > 0.0 and abs(share / one["share_of_copy"] - 1.0) < 1e-9
    assert [one["nodes"] for one in found if "left_out" in one] == [10**9, 10**9]
    wholes = [one for one in found if "parts_s" in one]
    assert [one["case"] for one in wholes] == ["panel_million, whole", "panel_million_spatial, whole"]
    for one in wholes:
        assert one["finished"] and one["parts_s"]["steps"] > 0.0
        assert abs(sum(one["parts_s"].values()) / one["wall_s"] - 1.0) < 0.1
    assert all(one["case"] in said.stdout for one in found)
