"""Two hooked wires: errors of planar contact treatments, and of the planar model.

    python tools/studies/hooks.py plane [DIR] [--nodes N]                  some minutes
    python tools/studies/hooks.py space [DIR] [--nodes N] [--levels N]     about fifteen minutes

*plane* runs scenes/hook_*.toml and sweeps what each treatment has of its own. It prints a table and leaves hook_curves.csv (a row
a recorded state), hook_sweeps.csv (a row a run), and hook_study.png. The reference, hook_reference.py, is solved at the span of
each treatment (1.25 d where a body of radius d/8 sits in between, d for a point, negative for a ring), so that an error is the
treatment's and not its geometry's; `against_hook` compares with 1.25 d whatever the treatment.

*space* runs the spatial hook and a free body at several coefficients of friction, and without friction with wires that touch at a
part of their thickness and with other resistance to twist; it compares them with the reference at fixed spans, and at the span
that wires which wind round each other keep (lens_law.py). It writes hook_spatial.csv and hook_spatial.png.
"""

from __future__ import annotations

import argparse
import sys

from hook_plane import study_plane
from hook_space import study_space
from study import add_directory, run_one_of


def add_options(name: str, parser: argparse.ArgumentParser) -> None:
    add_directory(parser)
    parser.add_argument("--nodes", type=int, default=48, help="segments a wire")
    if name == "space":
        parser.add_argument("--levels", type=int, default=8)


if __name__ == "__main__":
    sys.exit(run_one_of(__doc__, {"plane": study_plane, "space": study_space}, add_options))
