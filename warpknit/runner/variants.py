"""The results of [variants]: means over meshes with scatter, and the deviations of single meshes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.text import percent
from ..knit.cloth import CLASS_NAMES
from ..results.finding import ResultWarning
from ..results.row import Row, Values
from ..scene import Scene
from ..scene.options import Variants

# figures with a reported scatter
FIGURES = (
    "strain_weft", "strain_warp", "tension_weft_N_per_m", "tension_warp_N_per_m", "active_percent", "active_bodies", "elsewhere",
    "force_max_N", "force_mean_N", "light_percent", "contact_force_max_N", "stress_max_Pa", "stress_interior_max_Pa",
    "stress_p99_Pa", "stress_max_so_far_Pa", "yield_fraction", "plastic_fraction", "thickness_m",
)  # fmt: skip
CLOSING = tuple(f"force_{name}_N" for name in CLASS_NAMES)  # by which contacts of a class close: in half of the meshes
PLACES = ("stress_max_wire", "stress_max_node", "stress_max_x_m", "stress_max_y_m")  # of one mesh: they have no mean
PERCENTILES = (10.0, 90.0)
SMALL_TENSION = 1e-3  # of EI/C^3, the scale of tensions
EARLY, MOST = 0.4, 4  # of the requested standard error, where half of the meshes are enough; largest multiple
# codes of warnings that one path depends on the way, on which means over meshes do not depend
OF_ONE_PATH = {"W18", "W19", "W32"}
FEWEST = 4  # meshes, of a standard error that ends a run early
# Two branches: with fewer meshes, or a smaller gap between them over the deviation on each, they may be one. Of normal deviates
# 16 have such a gap in one of a thousand draws.
FEWEST_OF_BRANCHES, GAP, LEAST_GAP = 12, 3.0, 0.05  # the last of the mean


class Spread(Values):
    """A figure of the meshes."""

    mean: float  # of all meshes
    std: float  # standard deviation
    p10: float  # a tenth of the meshes is below
    p90: float  # a tenth of the meshes is above
    standard_error: float  # of the mean: std over the square root of the number of meshes


class Branch(Values):
    """Meshes apart from the others, on another branch of equilibria."""

    count: int  # meshes on that branch
    figure: str  # name of the value that separates the branches
    mean: float  # mean of this value on this branch
    others: float  # mean of this value over the other meshes
    stress_max_Pa: float  # mean of the largest stress on this branch


class Means(Values):
    """The section `variants` of summary.json, with a `Spread` of each figure: `tension_weft_N_per_m`."""

    count: int  # number of meshes in the mean
    failed: int  # meshes that did not converge, which are left out
    refused: int  # seeds whose loops do not fit, which others replace
    why: str  # reason for the first of these
    standard_error: float | None  # largest one, of tension or strain, of stress and of active contacts
    median: int  # number of the mesh whose states are kept
    branch: Branch | None  # meshes on another branch of equilibria; null where all are together
    changes: Values  # change of the means with other nodes, other friction and an overshoot, as fractions, by name and value


@dataclass(frozen=True)
class MeshValues:
    """Figures whose standard errors end a run: (mesh, figure), and what an error of each is measured by."""

    names: tuple[str, ...]
    values: NDArray[np.float64]
    scale: NDArray[np.float64]

    @property
    def standard_error(self) -> float:
        """The largest, over its scale."""
        count = len(self.values)
        if count < 2:
            return np.inf
        return float((self.values.std(axis=0, ddof=1) / np.sqrt(count) / self.scale).max())

    @property
    def median(self) -> int:
        """The mesh near the medians of all figures: its farthest one, in deviations, is nearest."""
        deviation = self.values.std(axis=0)
        away = (self.values - np.median(self.values, axis=0)) / np.where(deviation > 0.0, deviation, 1.0)
        return int(np.argmin(np.abs(away).max(axis=1)))


def mesh_values(by_tension: Sequence[bool], ends: Sequence[Row], scale: float) -> MeshValues:
    """Last values of each mesh: tension (driven: strain), active contacts, largest stress.

    by_tension: in weft and warp; scale [N/m]: of a small tension.
    """
    names = [
        f"strain_{side}" if driven else f"tension_{side}_N_per_m"
        for side, driven in zip(("weft", "warp"), by_tension, strict=True)
    ]
    tension, strain = (max(abs(np.mean([row[f"{what}_{side}{unit}"] for row in ends])) for side in ("weft", "warp"))
                       for what, unit in (("tension", "_N_per_m"), ("strain", "")))  # fmt: skip
    stress = np.mean([row.stress_max_Pa for row in ends])
    sides = [max(strain, 1e-3) if driven else max(tension, scale) for driven in by_tension]
    names += ["active_percent", "stress_max_Pa"]
    values = np.array([[row[name] for name in names] for row in ends], dtype=float)
    return MeshValues(tuple(names), values, np.array([*sides, 100.0, max(stress, 1.0)]))


def mesh_values_of(scene: Scene, ends: Sequence[Row]) -> MeshValues:
    """`mesh_values` of a run; smaller tensions than a share of EI/C^3 do not count."""
    scale = SMALL_TENSION * (scene.wire.bending_stiffness / scene.knit.course_spacing**3)
    return mesh_values(scene.stages[-1].by_tension, ends, scale)


def wanted(count: int, standard_error: float, found: int, error: float) -> int:
    """Number of meshes to run, after `found` meshes with a standard `error`; `found` itself if these are enough."""
    half = count // 2
    if found < half and standard_error and half >= FEWEST:
        return half
    if found < count:
        return found if found == half >= FEWEST and error < EARLY * standard_error else count
    enough = error <= standard_error or not standard_error or found >= MOST * count
    return found if enough else min(2 * found, MOST * count)


def first_meshes(variants: Variants) -> int:
    """Number of meshes that run first, before the check whether they are enough."""
    return wanted(variants.count, variants.standard_error, 0, math.inf)


def range_of(values: Any) -> NDArray[np.float64]:
    """Range (2, ...) of eight in ten other meshes, from values (mesh, ...), for any distribution.

    The k-th smallest of n values exceeds k/(n + 1) of all on average; fewer than nine have no more than their extremes.
    """
    return np.asarray(np.percentile(values, PERCENTILES, axis=0, method="weibull"))


def mean_row(rows: Sequence[Row], median: int) -> Row:
    """Mean of rows of the same load; places and words are the `median` mesh's.

    p10_NAME, p90_NAME: a tenth of the meshes is below p10, a tenth above p90.
    """
    mean = {name: _mean([row.get(name) for row in rows], value) for name, value in vars(rows[median]).items()}
    mean |= {name: float(np.median([row[name] for row in rows])) for name in CLOSING if mean.get(name) is not None}
    of_one = {name: rows[median][name] for name in PLACES if name in mean}
    mean |= of_one | {"steps": sum(row.steps for row in rows)}
    del mean["variant"]
    for name, spread in spreads(rows).items():
        mean |= {f"p10_{name}": spread.p10, f"p90_{name}": spread.p90}
    return Row(**mean)


def _mean(values: Sequence[Any], median: Any) -> Any:
    if isinstance(median, bool | np.bool_):
        return all(values)
    if isinstance(median, Mapping):
        return {name: _mean([value[name] for value in values], one) for name, one in median.items()}
    numbers = [value for value in values if isinstance(value, int | float | np.number)]
    if isinstance(median, str) or not numbers:
        return median
    if all(value == numbers[0] for value in numbers):
        return numbers[0]
    return float(np.mean(np.array(numbers, dtype=float)))


def spreads(ends: Sequence[Row]) -> dict[str, Spread]:
    """The spread of each figure over the last rows of the meshes."""
    figures = {name: [row[name] for row in ends if row.get(name) is not None] for name in FIGURES}
    return {name: spread_of(values) for name, values in figures.items() if values}


def spread_of(values: Sequence[float]) -> Spread:
    """The spread of a figure over the meshes."""
    std = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    p10, p90 = range_of(values).tolist()
    return Spread(mean=float(np.mean(values)), std=std, p10=p10, p90=p90, standard_error=std / math.sqrt(len(values)))


def variant_warnings(variants: Means, asked: float) -> Iterator[ResultWarning]:
    """Warnings on the means; asked: requested standard error, or 0."""
    if variants.failed:
        text = f"{variants.failed} of {variants.count + variants.failed} meshes did not converge and are left out"
        yield ResultWarning("W60", f"{text}. The first: {variants.why}.")
    error = variants.standard_error or 0.0
    if asked and error > asked:
        text = f"The standard error of the means is {percent(error)}, above {percent(asked)}."
        yield ResultWarning("W61", text)


def branch_of(seen: MeshValues) -> Branch | None:
    """The smaller of two groups of meshes with a gap between them; None for a single group."""
    count = len(seen.values)
    best: tuple[float, str, NDArray[np.bool_]] | None = None
    for name, values in zip(seen.names, seen.values.T, strict=True):
        if name == "active_percent":  # whole contacts, with gaps between them
            continue
        ordered = np.sort(values)
        for k in range(2, count - 1):
            parts = ordered[:k], ordered[k:]
            within = np.sqrt(sum(len(part) * part.var() for part in parts) / (count - 2))
            gap = ordered[k] - ordered[k - 1]
            is_wide = gap > LEAST_GAP * np.abs(values).mean() and gap > GAP * within
            if is_wide and (best is None or gap / max(within, 1e-300) > best[0]):
                best = gap / max(within, 1e-300), name, values < ordered[k]
    if best is None or count < FEWEST_OF_BRANCHES:
        return None
    _, name, low = best
    fewer = low if 2 * np.count_nonzero(low) <= count else ~low
    column, stress = seen.values[:, seen.names.index(name)], seen.values[:, seen.names.index("stress_max_Pa")]
    return Branch(
        count=int(fewer.sum()), figure=name, mean=float(column[fewer].mean()), others=float(column[~fewer].mean()),
        stress_max_Pa=float(stress[fewer].mean()),
    )  # fmt: skip
