"""Warp kernels of warpknit: they know arrays, never objects. Their modules are in kernels/, in a wheel beside this file.

Two storage precisions come from one source. ``single`` keeps displacements from the affinely mapped rest shape as 32-bit
fixed point (``unit`` metres a count, so that differences are exact and slow motion is never lost) and everything else as
float32; ``double`` keeps both as float64 (``unit`` is 1).
"""

from pathlib import Path

import warp as wp

if (_folder := Path(__file__).parents[2] / "kernels").joinpath("native").is_dir():
    __path__.append(str(_folder))

wp.config.log_level = wp.LOG_WARNING
wp.config.enable_backward = False  # nobody differentiates; it halves the time to compile
wp.config.default_grid_stride = False  # a thread has one place in a launch: fewer registers and instructions on a GPU
