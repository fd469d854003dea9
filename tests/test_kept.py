"""Variables that outlast a step: None as a saved value, and a variable that was not saved."""

from pathlib import Path

import numpy as np
import pytest

from warpknit.base.errors import RunDirectoryError
from warpknit.compute.kept import Owner, restore, save
from warpknit.compute.ranks import Ranks
from warpknit.runner.monitor import FILE, Checkpoint, write_checkpoint
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

CELL = Path(__file__).parents[1] / "scenes" / "atlas_cell.toml"


class Variables:
    KEPT = ("last", "lasts")

    def __init__(self, last: object, lasts: object) -> None:
        self.last, self.lasts = last, lasts


def test_none_is_a_value() -> None:
    kept = save(Owner(Variables(None, [None, 2.0])))
    restored = Variables(1.0, None)
    restore(kept, Owner(restored))
    assert restored.last is None and restored.lasts == [None, 2.0]


@pytest.mark.parametrize("missing", ["Variables.last", "Variables.lasts.1"])
def test_a_variable_that_was_not_saved_is_named(missing: str) -> None:
    kept = save(Owner(Variables(1.0, [1.0, 2.0])))
    del kept[missing]
    with pytest.raises(KeyError, match=missing):
        restore(kept, Owner(Variables(None, None)))


def test_a_checkpoint_without_a_variable_is_refused_in_one_line(tmp_path: Path) -> None:
    model = build_model(load_scene(CELL, ["output.frames=1"], "draft"), "cpu")
    simulation = Simulation(model)
    write_checkpoint(tmp_path, simulation, 0.0, {"rows": []})
    with np.load(tmp_path / FILE) as file:
        arrays = dict(file)
    assert arrays.pop("0/Relaxation._last_gradient/type").item() == '["NoneType", []]'
    np.savez(tmp_path / FILE, **arrays)
    with pytest.raises(RunDirectoryError, match=r"^[^\n]*'Relaxation._last_gradient'[^\n]*--force$"):
        Checkpoint(tmp_path, Ranks()).restore(simulation)
