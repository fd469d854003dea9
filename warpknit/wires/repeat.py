"""Wires of several repeats as one: what a periodic wire goes on as is the next piece of it, until it comes back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from warpknit.wires.centre_lines import Wires


def repeated(wires: Wires, repeats: tuple[int, int]) -> Wires:
    """The wires of so many repeats along x and y, which from then on are one repeat.

    A periodic wire that goes on by (i, j) repeats passes through n = lcm(a/gcd(a, i), b/gcd(b, j)) of the a x b there are before
    it is back where it began; so it becomes a b/n wires of n pieces, each going on by (n i/a, n j/b) of the larger repeats.
    """
    if wires.period is None or repeats == (1, 1):
        return wires
    points, kinds, shifts, origin, counts = [], [], [], [], []
    for number, (piece, kind) in enumerate(zip(wires.points, wires.kinds, strict=True)):
        shift = wires.shifts[number]
        count = math.lcm(*(side // math.gcd(side, int(step)) for side, step in zip(repeats, shift, strict=True)))
        taken = np.zeros(repeats, dtype=bool)
        for start in np.ndindex(*repeats):
            if taken[start]:
                continue
            cells = np.array(start) + np.arange(count)[:, None] * shift
            taken[tuple((cells % repeats).T)] = True
            places = np.column_stack([cells * wires.period, np.zeros(count)])
            points.append((piece + places[:, None]).reshape(-1, 3))
            kinds.append(kind)
            shifts.append(count * shift // repeats)
            origin.append(number)
            counts.append(count)

    def of_copies(values: tuple[np.ndarray, ...] | None) -> tuple[np.ndarray, ...] | None:
        if values is None:
            return None
        pieces = zip(origin, counts, strict=True)
        return tuple(np.concatenate([values[number]] * count) for number, count in pieces)

    return replace(
        wires,
        points=tuple(points),
        kinds=tuple(kinds),
        shifts=np.array(shifts, dtype=np.int64),
        period=wires.period * repeats,
        radius=None if wires.radius is None else wires.radius[origin],
        rest_lengths=of_copies(wires.rest_lengths),
        natural_turns=of_copies(wires.natural_turns),
        twist_strains=of_copies(wires.twist_strains),
    )
