"""Errors of presets, of `warpknit run --error` and of single precision, against better runs.

    python tools/studies/accuracy.py presets [DIR] [--quick]
    python tools/studies/accuracy.py space [DIR] [--quick]
    python tools/studies/accuracy.py estimate [DIR] [--error PERCENT] [--quick]
    python tools/studies/accuracy.py precision [DIR] [--quick]

*presets*: what the presets, and node counts between them, miss on many scenes: the numbers in warpknit/scene/presets.py. Each
scene is run at each setting, tiles in five levels, patches in one, hooks in their own, and held against TRUE_NODES in double
precision to a tolerance of 1e-4 (1e-3 of patches and with friction). Leaves presets.csv, a row a scene and setting, and prints
the worst and the median error of each setting; goes on with the scenes that are missing there.

*space*: the same for presets of spatial models, on the tile of the double atlas, on two tight knits, and on four of thick wire,
in presets_spatial.csv.

*estimate*: is the error that `warpknit run --error 2` estimates above the true one? Ten scenes that its numbers were not set by,
each run as `run --error` runs it, in five levels, and then with CHECK_NODES in double precision to a tolerance of 1e-4 (1e-3 of a
gripped mesh). Leaves error_check.csv and goes on with the scenes that are missing there; prints in how many the true error was
under the estimate.

*precision*: single against double precision, error and speed on the main patch and on a strip of one metre, in precision.csv.
Single precision is a mixed one: displacements are 32-bit fixed point; forces, velocities and rest data float32; what adds up
over steps or over the mesh (load, time, sums of energy and forces, places in the neighbour search) float64. In double precision
all is float64. Both run the same scene; errors are against double precision with a residual ten times smaller. Speed is
measured on one thread from the state at rest, the best of rounds with both precisions in turn. --quick leaves out the strip.
"""

from __future__ import annotations

import argparse
import sys

from accuracy_estimate import study_estimate
from accuracy_precision import study_precision
from accuracy_presets import study_presets, study_space
from study import add_directory, run_one_of

QUICK = {
    "presets": "a coarser reference and three scenes",
    "space": "a coarser reference, one scene and one preset",
    "estimate": "34 nodes count as true, and two scenes are run",
    "precision": "leave out the strip",
}


def add_options(name: str, parser: argparse.ArgumentParser) -> None:
    add_directory(parser, quick=QUICK[name])
    if name == "estimate":
        parser.add_argument("--error", type=float, default=2.0, metavar="PERCENT")


if __name__ == "__main__":
    studies = {"presets": study_presets, "space": study_space, "estimate": study_estimate, "precision": study_precision}
    sys.exit(run_one_of(__doc__, studies, add_options))
