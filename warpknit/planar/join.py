"""Arrays of the global mesh, gathered from the strips."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .model import Model


class Join:
    """Gathers arrays of all ranks on the first one, or `everywhere`; a collective call. With one rank it returns its arrays.

    On ranks without a result the arrays are empty.
    """

    def __init__(self, model: Model, *, everywhere: bool = False) -> None:
        self._strip, self._panel = model.strip, model.global_model.panel
        self._collect: Callable[[np.ndarray], list[np.ndarray]] = model.ranks.everyone if everywhere else model.ranks.gather
        if model.strip is not None:
            self._body_places = self._collect(model.strip.body[: model.strip.owned_bodies])
            self._pair_places = self._collect(model.strip.pair_of_whole)

    def nodes(self, values: np.ndarray) -> np.ndarray:
        """[node, ...] of the global mesh; nodes are in the order of the wires."""
        if self._strip is None:
            return values
        parts = self._collect(values)
        return np.concatenate(parts) if parts else values[:0]

    wires = clamps = nodes

    def bodies(self, values: np.ndarray) -> np.ndarray:
        """[body, ...]"""
        if self._strip is None:
            return values
        return self._placed(values[: self._strip.owned_bodies], self._body_places, self._panel.body_count)

    def pairs(self, values: np.ndarray) -> np.ndarray:
        """[pair, ...]"""
        if self._strip is None:
            return values
        return self._placed(values[self._strip.pair], self._pair_places, 2 * self._panel.body_count)

    def _placed(self, values: np.ndarray, places: list[np.ndarray], count: int) -> np.ndarray:
        """(count, ...) with the values of each rank at its places."""
        parts = self._collect(values)
        joined = np.empty((count if parts else 0, *values.shape[1:]), dtype=values.dtype)
        for part, place in zip(parts, places, strict=True):
            joined[place] = part
        return joined
