"""HF-1 pulled to break: which input would have to be what for the elongation that was measured.

    python tools/studies/pulled_inputs.py [DIR] [--quick]

The strip of pulled_meshes.py, by spacings, by friction, by run-in, and with its width held as knitted in place of free sides.
Clamps hold the width at both ends of a strip, and its middle is free, so that a strip is between the two. Prints and writes a row
for each pull (pulled_inputs.csv): the strain at which it carries the force that was measured at break. Nothing is fitted.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from pulled_data import MESHES, Case
from pulled_meshes import DIRECTIONS, STIFF, scene_of
from strip_bounds import straight_strain
from strip_pull import pull
from study import add_directory, new_parser, show_rows, start_study, table_path, write_rows

HF_1 = MESHES[0]


@dataclass(frozen=True)
class Input:
    """One choice of inputs: wales and courses an inch, friction coefficient, factor of both run-ins, sides."""

    spacing: tuple[float, float] = HF_1.spacings["base"]
    friction: float = 0.2
    run_in: float = 1.0
    sides: str = "free"  # free | held
    direction: str = "warp"


# courses by the rule of pulled_data.py: what the run-in allows
INPUTS = (
    *(Input(spacing) for spacing in ((26, 33), (28, 30), (32, 28), (34, 26), (36, 25), (38, 24))),
    *(Input(spacing, sides="held") for spacing in ((26, 33), (28, 30), (32, 28), (34, 26), (36, 25))),
    Input(friction=0.1),
    Input(friction=0.3),
    Input((26, 36), run_in=0.95),
    Input((26, 30), run_in=1.05),
    *(Input(spacing, direction="weft") for spacing in ((34, 26), (36, 25))),
)
QUICK = (Input((32, 28)), Input((32, 28), sides="held"))


@dataclass(frozen=True)
class InputRow:
    """A row of pulled_inputs.csv, SI."""

    direction: str
    wales: float  # an inch
    courses: float
    friction: float
    run_in: float  # of that published
    sides: str
    ending: str
    last_strain: float
    last_force: float
    stiff_strain: float  # from which it carries STIFF
    strain: float  # at which it carries the force that was measured at break; nan: not reached
    straight_strain: float
    measured_strain: float
    seconds: float


def rows_of(inputs: tuple[Input, ...]) -> Iterator[InputRow]:
    """A row for each choice."""
    for given in inputs:
        begin, axis, measured = time.process_time(), DIRECTIONS[given.direction], HF_1.measured[given.direction]
        assert HF_1.run_in is not None
        mesh = replace(HF_1, run_in=tuple(given.run_in * length for length in HF_1.run_in))
        scene = scene_of(mesh, given.spacing, Case("", {"contact.friction": given.friction}))
        end = straight_strain(scene, axis)
        pulled = pull(scene, axis, end + 0.05, step=0.04, strength=HF_1.strength[1], steps=70_000, held=given.sides == "held")
        last = pulled.levels[-1]
        yield InputRow(
            given.direction, *given.spacing, given.friction, given.run_in, given.sides, pulled.ending, last.strain, last.force,
            pulled.strain_at(STIFF), pulled.strain_at(measured.force / measured.width), end, measured.strain,
            time.process_time() - begin,
        )  # fmt: skip


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser, quick="32 wales an inch; under a minute")
    given = start_study(parser)
    rows: list[InputRow] = []
    for row in rows_of(QUICK if given.quick else INPUTS):
        rows.append(row)
        write_rows(table_path(given, "pulled_inputs.csv"), rows)
        print(f"{row.direction} {row.wales:g} x {row.courses:g} {row.sides}: {row.ending} at {row.last_strain:.3f}", flush=True)
    show_rows(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
