"""Fixtures for wires read from files."""

import os

import pytest


@pytest.fixture
def stages_read_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """USD stages are read by this process, which is quicker; test_bad_files.py has the process that reads them elsewhere."""
    from pxr import Usd

    from warpknit.wires import file_curves
    from warpknit.wires.stage_process import stage_arrays

    monkeypatch.setattr(file_curves, "_read_stage", lambda path, time, _: stage_arrays(Usd.Stage.Open(os.fspath(path)), time))
