"""An experiment that decides between the models: a mesh under equal tensions, and small changes of each of them, as predicted.

    python tools/studies/experiment.py [DIR] [--quick]

Two samples: a control, for which planar and spatial models agree, and a tight mesh, for which they do not. At each tension of
weft and warp alike, one of them is raised by a fifth with the other held: stiffness and Poisson's ratio. Each round (STEPS)
closes, so that it shows whether the mesh has an energy. What a laboratory would not know is varied one at a time (CASES). Prints
and writes a row for each state (experiment.csv) and the picture.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from experiment_picture import MODELS, SIDES, draw
from pulled_data import MESHES, with_run_in
from pulled_meshes import INCH
from study import add_directory, new_parser, picture_path, show_rows, start_study, table_path, write_rows

from warpknit import measure
from warpknit.base.errors import Diverged
from warpknit.knit.named import named_knit
from warpknit.measure.network import contact_resistances, sheet_resistance
from warpknit.scene import Scene, make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

TENSIONS = (0.5, 1.0, 2.0, 3.4, 4.9)  # [N/m]; the last three are in service
RAISE = 1.2  # of one tension, with the other held
STEPS = ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0))  # of a round: whether weft and warp are raised
GOLD = {"plating": {"material": "gold", "thickness": "0.2 um"}}


@dataclass(frozen=True)
class Sample:
    """A mesh that a laboratory can have knitted, with its spacings [an inch]: base, and other cases."""

    name: str
    title: str
    bars: tuple[dict[str, Any], ...]
    wire: dict[str, Any]
    spacings: dict[str, tuple[float, float]]
    run_in: tuple[float, float] | None = None  # [m] a rack, in the order of the bars


_ATLAS, _LOCKNIT = named_knit("double-atlas"), MESHES[0]
SAMPLES = (
    Sample(
        "control", "control: half-set double atlas, 30 um",
        tuple({"chain": bar.chain, "threading": bar.threading, "shift": bar.shift} for bar in _ATLAS.bars),
        {"material": "molybdenum", "diameter": "30 um", **GOLD},
        {"base": (15, 25), "wales and courses -3 %": (14.55, 24.25), "wales and courses +3 %": (15.45, 25.75)},
    ),
    Sample(
        "tight", "tight: reverse locknit, 4 x 17 um", _LOCKNIT.bars, {**_LOCKNIT.wire, **GOLD},
        _LOCKNIT.spacings, _LOCKNIT.run_in,
    ),
)  # fmt: skip
CASES: dict[str, dict[str, Any]] = {
    "set 0.9": {"wire.set_fraction": 0.9},
    "soft gold": {"wire.hardness": "0.2 GPa"},
    "hard gold": {"wire.hardness": "2 GPa"},
}


@dataclass(frozen=True)
class Row:
    """A row of experiment.csv: a state under equal tensions, SI. Stiffness is the secant over RAISE, the other tension held.

    Compliances across are relative to the width before, and means of the steps at either value of the other tension. In a mesh
    that has an energy they are equal, up to the square of RAISE - 1.
    """

    sample: str
    model: str
    case: str
    tension: float
    strain_weft: float
    strain_warp: float
    stiffness_weft: float  # [N/m] change of the weft tension by the weft strain
    stiffness_warp: float
    poisson_weft: float  # warp contraction by weft extension, the weft tension raised
    poisson_warp: float
    across_weft: float  # [m/N] contraction in warp by the weft tension
    across_warp: float
    active_percent: float
    contact_ohm: float  # median
    force_median: float  # [N] of the contacts
    sheet_weft_ohm: float
    sheet_warp_ohm: float
    stress_max: float


def scene_of(
    sample: Sample,
    model: str,
    spacing: tuple[float, float],
    changes: dict[str, Any],
    tensions: tuple[float, ...],
    raised: float = RAISE,
) -> Scene:
    """One repeat, loaded to each tension of both sides, and through a round there."""
    stages = [
        {f"tension_{side}": tension * raised**share for side, share in zip(SIDES, step, strict=True)}
        for tension in tensions
        for step in STEPS
    ]
    table = {
        "wire": sample.wire,
        "knit": {"bars": list(sample.bars), "wale_spacing": INCH / spacing[0], "course_spacing": INCH / spacing[1]},
        "model": {"kind": model, "boundary": "periodic"},
        "contact": {"friction": 0.0},
        "load": stages[0],
        "path": stages[1:],
        "solver": {"preset": "draft", "residual_tolerance": 2e-3, "precision": "double"},
        "output": {"frames": 1},
    }
    return with_run_in(make_scene(table, list(changes.items())), sample.run_in)


@dataclass
class _Ends:
    """Records at the ends of load steps, and why a run ended early."""

    observed: list[Any] = field(default_factory=list)
    said: str = ""


def ends_of(scene: Scene) -> _Ends:
    """The states at the ends of the stages."""
    ends = _Ends()
    try:
        for record in Simulation(build_model(scene)).run():
            if record.load_factor == 1.0:
                ends.observed.append(record.observables)
    except Diverged as error:
        ends.said = str(error)
    return ends


def rows_of(sample: Sample, model: str, case: str, scene: Scene, tensions: tuple[float, ...]) -> Iterator[Row]:
    """A row for each tension whose round was completed."""
    ends = ends_of(scene)
    if ends.said:
        print(f"{sample.name} {model} {case}: {ends.said}")
    for number, tension in enumerate(tensions[: len(ends.observed) // len(STEPS)]):
        equal, weft, both, warp, back = ends.observed[len(STEPS) * number :][: len(STEPS)]
        by_weft, by_warp = _strains(weft) - _strains(equal), _strains(warp) - _strains(back)
        of_weft = measure.mesh_tension(weft)[0] - measure.mesh_tension(equal)[0]
        of_warp = measure.mesh_tension(warp)[1] - measure.mesh_tension(back)[1]
        across_weft = 0.5 * (_contraction(equal, weft, 0) + _contraction(warp, both, 0))
        across_warp = 0.5 * (_contraction(back, warp, 1) + _contraction(weft, both, 1))
        ohm, force = contact_resistances(equal), measure.active_forces(equal)
        sheet = [math.nan if value is None else value for value in sheet_resistance(equal)]
        yield Row(
            sample.name, model, case, tension, *_strains(equal), of_weft / by_weft[0], of_warp / by_warp[1],
            -by_weft[1] / by_weft[0], -by_warp[0] / by_warp[1], across_weft, across_warp,
            measure.contacts(equal).active_percent, float(np.median(ohm)) if len(ohm) else math.nan,
            float(np.median(force)) if len(force) else 0.0, *sheet, float(measure.stress_extremes(equal)[0]),
        )  # fmt: skip


def _contraction(before: Any, after: Any, raised: int) -> float:
    """Relative decrease of the other side [m/N] by the tension of the `raised` side."""
    shorter = np.log1p(_strains(before)[1 - raised]) - np.log1p(_strains(after)[1 - raised])
    return float(shorter / (measure.mesh_tension(after)[raised] - measure.mesh_tension(before)[raised]))


def _strains(observed: Any) -> np.ndarray:
    return np.asarray(np.diag(observed.gradient) - 1.0)


def cases_of(sample: Sample) -> Iterator[tuple[str, tuple[float, float], dict[str, Any]]]:
    """Name, spacings and changes of each case, the base first."""
    for name, spacing in sample.spacings.items():
        yield name, spacing, {}
    for name, changes in CASES.items():
        yield name, sample.spacings["base"], changes


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser, quick="the base cases at two tensions; under a minute")
    given = start_study(parser)
    tensions = (1.0, 2.0) if given.quick else TENSIONS
    rows: list[Row] = []
    for sample in SAMPLES:
        for case, spacing, changes in list(cases_of(sample))[: 1 if given.quick else None]:
            for model in MODELS:
                scene = scene_of(sample, model, spacing, changes, tensions)
                found = list(rows_of(sample, model, case, scene, tensions))
                rows += found
                show_rows(found) if found else print(f"{sample.name} {model} {case}: no tension reached")
    write_rows(table_path(given, "experiment.csv"), rows)
    draw(picture_path(given, "experiment.png"), rows, {sample.name: sample.title for sample in SAMPLES})
    return 0


if __name__ == "__main__":
    sys.exit(main())
