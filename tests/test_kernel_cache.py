"""A kernel cache that cannot be written is refused in one line."""

import os
import subprocess
import sys
from pathlib import Path

SCENE = Path(__file__).parents[1] / "scenes" / "atlas_cell.toml"


def test_a_kernel_cache_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path / "file" / "cache")}
    command = [sys.executable, "-m", "warpknit", "plan", str(SCENE)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "WARP_CACHE_PATH" in done.stderr
