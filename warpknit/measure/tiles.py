"""Tiles of a gripped panel, and the map of their values.

A tile is one repeat of the undeformed cloth. Its nominal stress P is the virial of its wires and contacts, as in
`Observables.nominal_stress`. Its deformation gradient F is the panel's plus the slope of the displacement between tiles, averaged
over their common bodies. The tension is the force per current width, P F^T / det F.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import pair_active
from .observables import LEAST_SHARE, MeshModel, Observables, PanelMap, SheetPlaces
from .strain import rotation

FEWEST_TILES = 12  # area of a panel in tiles above which it has a map


def has_map(model: MeshModel) -> bool:
    """Whether the mesh is a gripped one of enough repeats."""
    panel, cloth = model.panel, model.cloth
    return panel.outline is not None and cloth is not None and panel.area >= FEWEST_TILES * float(np.prod(cloth.size))


@dataclass(frozen=True)
class Tiles:
    """The tiles of a panel at rest, around its middle; numbered column by column."""

    model: MeshModel
    low: np.ndarray  # (2,) [m] lower corner of the first tile
    size: np.ndarray  # (2,) [m] of a tile
    shape: tuple[int, int]  # columns, rows

    @classmethod
    def of(cls, model: MeshModel) -> Tiles:
        """Tiles of a panel with a knit."""
        panel, cloth = model.panel, model.cloth
        assert cloth is not None
        tile = np.array(cloth.size)
        columns, rows = np.maximum(1, np.ceil(panel.size / tile - 1e-9)).astype(int).tolist()
        return cls(model, panel.low + 0.5 * (panel.size - tile * (columns, rows)), tile, (columns, rows))

    @cached_property
    def of_body(self) -> np.ndarray:
        """[body] tile of each body: shifted by whole repeats, and so independent of rounding at the borders."""
        panel = self.model.panel
        return self._number(np.floor((panel.body_rest - self.low) / self.size) + np.rint(panel.body_origin / self.size))

    @cached_property
    def share(self) -> np.ndarray:
        """(column, row) share of a tile inside the outline."""
        outline = self.model.panel.outline
        assert outline is not None
        return outline.cover(self.low, self.size, self.shape)

    def at(self, place: np.ndarray) -> np.ndarray:
        """[point] tile of points at rest (point, 2) [m]."""
        return self._number(np.floor((place - self.low) / self.size))

    def _number(self, steps: np.ndarray) -> np.ndarray:
        column, row = np.clip(steps.astype(np.int64), 0, np.array(self.shape) - 1).T
        return np.asarray(column * self.shape[1] + row)

    def zeros(self, *of_tile: int) -> np.ndarray:
        """(tile, ...) zeros."""
        return np.zeros((self.shape[0] * self.shape[1], *of_tile))

    def add(self, total: np.ndarray, where: np.ndarray, values: np.ndarray) -> None:
        """Add values (point, 2, 2) of points in the tiles `where` [point] to total (tile, 2, 2)."""
        for a, b in np.ndindex(2, 2):
            total[:, a, b] += np.bincount(where, values[:, a, b], minlength=len(total))


def panel_map_of(
    r: Observables,
    tiles: Tiles,
    virial: np.ndarray,
    stress_max: np.ndarray,
    body_moved: np.ndarray,
    sheet: SheetPlaces | None = None,
) -> PanelMap:
    """The map of a panel, from values of its tiles.

    virial (tile, 2, 2) [J]: nominal stress times area; stress_max [tile] [Pa]; body_moved (body, 2) [m]: displacement of the
    bodies from the affine prediction; sheet: of a mesh that may leave its plane.
    """
    model, shape, share = r.model, tiles.shape, tiles.share
    panel, known = model.panel, share >= LEAST_SHARE
    assert model.cloth is not None

    def shown(values: np.ndarray) -> np.ndarray:
        values = values.reshape(*shape, *values.shape[1:]).astype(float)
        values[~known] = np.nan
        return values

    count = len(virial)
    pairs = 2.0 * np.bincount(tiles.of_body, minlength=count)
    active = np.bincount(tiles.of_body, pair_active(r).reshape(-1, 2).sum(axis=1).astype(float), minlength=count)
    moved = np.full((len(model.cloth.clasps), count, 2), np.nan)
    moved[panel.body_clasp, tiles.of_body] = body_moved
    moved[:, ~known.ravel()] = np.nan
    turned = rotation(r.clamp_rotation)
    gradient = turned @ (r.gradient + _slopes(moved.reshape(-1, *shape, 2), tiles.size))
    nominal = turned @ (shown(virial) / (np.maximum(share, LEAST_SHARE) * np.prod(tiles.size))[..., None, None])
    tension = np.einsum("xyab,xycb->xyac", nominal, gradient) / np.linalg.det(gradient)[..., None, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        percent = shown(100.0 * active / pairs)
    gradient = np.where(known[..., None, None], gradient, np.nan)
    low = tiles.low - panel.low - 0.5 * panel.size
    return PanelMap(low, tiles.size, share, gradient, nominal, tension, percent, shown(stress_max), sheet)


def _slopes(moved: np.ndarray, tile: np.ndarray) -> np.ndarray:
    """(column, row, 2, 2) slope of the displacements (clasp, column, row, 2) [m] of bodies; nan where a tile lacks the clasp.

    The mean over the clasps that neighbouring tiles both have: central differences where both neighbours have some, else
    one-sided, else zero.
    """
    slopes = np.zeros((*moved.shape[1:3], 2, 2))
    for axis in range(2):
        steps = np.diff(np.moveaxis(moved, axis + 1, 0), axis=0) / tile[axis]  # (step, kind, along the other axis, 2)
        there = np.isfinite(steps[..., 0])
        kinds = there.sum(axis=1)
        step = np.where(there[..., None], steps, 0.0).sum(axis=1) / np.maximum(kinds, 1)[..., None]
        total, count = np.zeros((len(steps) + 1, *step.shape[1:])), np.zeros((len(steps) + 1, step.shape[1]))
        for part in (slice(1, None), slice(None, -1)):
            total[part] += step
            count[part] += kinds > 0
        slopes[..., axis] = np.moveaxis(total / np.maximum(count, 1.0)[..., None], 0, axis)
    return slopes
