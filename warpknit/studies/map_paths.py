"""Load paths of a map: pairs of loads in the same proportion are load steps of one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..scene import Scene, Stage
from .contact_map import Pair

SAME = 9  # digits of a proportion


@dataclass(frozen=True)
class MapPath:
    """Pairs of loads, the nearest first, and the levels of each."""

    pairs: tuple[Pair, ...]
    levels: int

    @property
    def count(self) -> int:
        """Load levels of all pairs."""
        return len(self.pairs) * self.levels

    def stages(self, scene: Scene) -> list[Stage]:
        """Load steps of the path in the scene of its map."""
        assert scene.sweep is not None
        return [scene.sweep.stage(scene.stages[0], pair) for pair in self.pairs]


def map_paths(scene: Scene) -> list[MapPath]:
    """All paths of a sweep, from the mesh as knitted.

    Increments are at most the largest load over `Scene.levels`. Beside a shear or a temperature each pair has its own path.
    """
    assert scene.sweep is not None
    load, found = scene.stages[0], dict[Pair, list[Pair]]()
    is_alone = load.shear != 0.0 or load.temperature != scene.wire.reference_temperature
    for pair in sorted(scene.sweep.pairs, key=_size):
        proportion = pair if is_alone else tuple(round(one / (_size(pair) or 1.0), SAME) for one in pair)
        found.setdefault((proportion[0], proportion[1]), []).append(pair)
    largest = max(map(_size, scene.sweep.pairs)) or 1.0

    def levels(pairs: list[Pair]) -> int:
        widest = float(np.diff([0.0, *map(_size, pairs)]).max())
        return max(1, math.ceil(widest / largest * scene.levels - 1e-9))

    return [MapPath(tuple(pairs), levels(pairs)) for pairs in found.values()]


def path_to(scene: Scene, pair: Pair) -> MapPath:
    """The path of a map to one of its pairs."""
    path = next(path for path in map_paths(scene) if pair in path.pairs)
    return replace(path, pairs=path.pairs[: path.pairs.index(pair) + 1])


def _size(pair: Pair) -> float:
    return max(map(abs, pair))
