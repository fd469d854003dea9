"""Speed of warpknit on this machine: one JSON object a case and line.

    python tools/bench.py                                    free wires, 1e4 to 1e6 nodes, both precisions, 1 and 2 threads
    python tools/bench.py --nodes 1e7 --contact --precision single
    python tools/bench.py --device cuda:0                    steps of both models and both scenes of a million, under ten minutes
    python tools/bench.py --usd --nodes 1e6                  what writing frames as USD costs
    python tools/bench.py --space --nodes 500 5000           steps of spatial wires, and times of their parts
    mpirun -n 2 python tools/bench.py --ranks --nodes 1e5    steps where ranks share a mesh, and what they spend on each other
    python tools/bench.py --search                           what finding contacts costs, of the patch or of --scene
    python tools/bench.py --map                              a contact map as one batch, beside its cells one by one
    python tools/bench.py --plan                             what `warpknit plan` says of scenes, beside what they take

The parts are in tools/benchmarks; its README says what each measures and how long it takes.
"""

from __future__ import annotations

import argparse
import json
from importlib import import_module
from pathlib import Path

from warpknit.compute.device import find_device

# option: (the part in tools/benchmarks, what it measures)
SUBJECTS = {
    "usd": ("usd", "write frames, beside numpy.tofile and while stepping"),
    "space": ("spatial", "cells of the spatial model at 10 %%"),
    "ranks": ("ranks", "the periodic tile shared by ranks; under mpirun"),
    "search": ("search", "neighbour search and contact of a scene"),
    "map": ("contact_map", "a contact map as one batch"),
    "plan": ("plan", "steps and times that are planned"),
}
SIZES = {"gpu": [2e5, 1e6, 5e6, 2e7]}  # default nodes, where they are others


def parser() -> argparse.ArgumentParser:
    found = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    subject = found.add_mutually_exclusive_group()
    for name, (part, text) in SUBJECTS.items():
        subject.add_argument(f"--{name}", dest="part", action="store_const", const=part, help=text)
    found.add_argument("--nodes", type=float, nargs="+", help="[default: 1e4 1e5 1e6; on a GPU 2e5 to 2e7]")
    found.add_argument(
        "--precision", nargs="+", choices=("single", "double"), default=["single", "double"], help="on a GPU the first alone"
    )
    found.add_argument("--threads", type=int, nargs="+", help="of each process.  [default: 1 2, of --ranks 1]")
    found.add_argument("--contact", action="store_true", help="the periodic mesh with its contacts at 12 %% strain")
    found.add_argument("--rounds", type=int, default=5, help="turns; of these the best counts")
    found.add_argument("--seconds", type=float, default=0.3, help="about how long a turn takes")
    found.add_argument("--device", default="cpu")
    found.add_argument("--minutes", type=float, default=9.0, help="on a GPU: what takes longer is left out")
    found.add_argument(
        "--scenes",
        type=float,
        default=0.5,
        help="on a GPU: share of the time for the scenes of a million; 0: without them",
    )
    found.add_argument("--json", type=Path, default=Path("bench_gpu.json"), help="on a GPU: where the results go")
    found.add_argument("--frames", type=int, default=20, help="of --usd")
    found.add_argument("--steps", type=int, default=400, help="of --usd, between two frames")
    found.add_argument("--folder", type=Path, help="of --usd: where to write.  [default: the system's for temporary files]")
    found.add_argument("--rows", type=int, help="of --ranks: rows of repeats, the length of a border")
    found.add_argument("--scene", help="of --search and --map")
    found.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="of --search and --space, and of the scenes on a GPU",
    )
    found.add_argument("--sample", type=int, default=10, metavar="N", help="of --map: run every Nth cell one by one")
    found.add_argument("--only", default="", metavar="WORD", help="of --plan: scenes whose name has this in it")
    return found


def main() -> None:
    options = parser().parse_args()
    if options.part is None:
        options.part = "planar" if options.device == "cpu" else "gpu"
    if options.nodes is None:
        options.nodes = SIZES.get(options.part, [1e4, 1e5, 1e6])
    if options.threads is None:
        options.threads = [1] if options.part == "ranks" else [1, 2]
    part = import_module(f"benchmarks.{options.part}")  # before the device, because it quiets Warp
    if options.part != "ranks":  # every rank finds its own
        options.device = find_device(options.device)
    results = []
    for found in part.cases(options):
        print(json.dumps(found), flush=True)
        results.append(found)
        if options.part == "gpu":  # also of what is broken off
            options.json.write_text(json.dumps(results, indent=1))
    if options.part == "gpu":
        print(part.table(results))


if __name__ == "__main__":
    main()
