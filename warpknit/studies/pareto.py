"""The Pareto front of error against cost."""

from __future__ import annotations

from collections.abc import Sequence


def pareto(points: Sequence[tuple[float, float]], least: float = 0.0) -> list[int]:
    """Indices of the non-dominated (cost, error) points, by increasing cost, up to the first whose error is below `least`."""
    order = sorted(range(len(points)), key=lambda k: points[k])
    front: list[int] = []
    for k in order:
        if not front or least <= points[front[-1]][1] > points[k][1]:
            front.append(k)
    return front
