"""A run that is interrupted and resumed again and again, against the same run in one go."""

from pathlib import Path

import numpy as np
import pytest

from warpknit.runner.monitor import Monitor
from warpknit.runner.run import run_scene
from warpknit.scene import Scene


def assert_parts_are_the_whole(scene: Scene, directory: Path, monkeypatch: pytest.MonkeyPatch, every: int) -> Path:
    """Run `scene` in one go and with an interruption at one of `every` checks: the same history and states, to the bit. Returns
    where the parts are. Without figures and stage, which take longer than the run."""
    scene = scene.changed({"output.figures": False, "output.usd": False})
    assert run_scene(scene, out=directory / "whole", device="cpu").exit_code == 0
    original, checks = Monitor._check, 0

    def interrupt_now_and_then(self: Monitor, progress: object) -> None:
        nonlocal checks
        checks += 1
        if checks % every == 7:
            self.interrupts.request()
        original(self, progress)

    monkeypatch.setattr(Monitor, "_check", interrupt_now_and_then)
    code = run_scene(scene, out=directory / "parts", device="cpu").exit_code
    interruptions = 0
    while code == 130:
        interruptions += 1
        code = run_scene(scene, out=directory / "parts", device="cpu", resume=True).exit_code
    assert code == 0 and interruptions > 2
    assert not (directory / "parts" / "checkpoint").exists()
    assert (directory / "whole" / "history.csv").read_text() == (directory / "parts" / "history.csv").read_text()
    states = sorted(path.name for path in (directory / "whole" / "states").iterdir())
    assert states
    for name in states:
        a, b = (np.load(directory / part / "states" / name) for part in ("whole", "parts"))
        assert all(np.array_equal(a[key], b[key]) for key in a.files)
    return directory / "parts"
