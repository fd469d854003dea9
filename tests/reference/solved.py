"""States that several tests solve, solved once a run of the tests, whichever process needs them first."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from filelock import FileLock

FOLDER_KEY = "WARPKNIT_TESTS_FOLDER"  # the environment variable that names the folder of a run of the tests


def solved(what: str, solve: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Arrays that `solve` returns for `what`, which must name all that they depend on."""
    path = Path(os.environ[FOLDER_KEY]) / f"{hashlib.sha256(what.encode()).hexdigest()}.npz"
    with FileLock(path.with_suffix(".lock")):
        if not path.exists():
            found = solve()
            partial = path.with_suffix(".partial.npz")
            np.savez(partial, **found)
            partial.rename(path)
        with np.load(path) as file:
            return {name: file[name] for name in file.files}
