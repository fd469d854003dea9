"""The map of a gripped planar panel (measure/panel_map.py), tile by tile.

A tile is one repeat of the undeformed cloth. Its nominal stress P is the virial of its wires and contacts, as in
measure.nominal_stress. Its deformation gradient F is that of the panel plus the slope of the displacement between tiles, averaged
over the bodies that both tiles have. The tension is the force per current width, P F^T / det F.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure.measures import pair_active
from ..measure.panel_map import LEAST_SHARE, PanelMap
from ..measure.strain import rotation
from .host_state import pair_levers

NODES_AT_ONCE = 1_000_000
FEWEST_TILES = 12  # area of a panel in tiles above which it has a map


def has_map(r: Any) -> bool:
    """Whether the mesh is a gripped one of enough repeats."""
    panel, cloth = r.model.panel, r.model.cloth
    return panel.outline is not None and cloth is not None and panel.area >= FEWEST_TILES * float(np.prod(cloth.size))


def find_panel_map(r: Any) -> PanelMap:
    """The map of a gripped panel."""
    panel, table, cloth = r.model.panel, r.model.table, r.model.cloth
    assert panel.outline is not None and cloth is not None
    tile = np.array(cloth.size)
    shape = tuple(np.maximum(1, np.ceil(panel.size / tile - 1e-9)).astype(int).tolist())
    middle = panel.low + 0.5 * panel.size
    low = middle - 0.5 * tile * shape

    def number(place: np.ndarray) -> np.ndarray:
        """Tile of points at rest positions (point, 2) [m]."""
        return index(np.floor((place - low) / tile))

    def index(steps: np.ndarray) -> np.ndarray:
        column, row = np.clip(steps.astype(np.int64), 0, np.array(shape) - 1).T
        return column * shape[1] + row

    def gather(where: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.bincount(where, values, minlength=shape[0] * shape[1])

    virial, stress_max = np.zeros((shape[0] * shape[1], 2, 2)), np.zeros(shape[0] * shape[1])
    force, stress = r.segment_force, r.wire_stress.node
    inside = np.any(r.edge != 0.0, axis=1)
    origin = np.repeat(np.arange(len(panel.block_first)), panel.block_count)
    for begin in range(0, panel.node_count, NODES_AT_ONCE):
        part = slice(begin, begin + NODES_AT_ONCE)
        entry = r.entry[part]
        where = number(np.stack([table.x[entry], table.y[entry]], axis=1) + panel.block_origin[origin[part]])
        np.maximum.at(stress_max, where, stress[part])
        rest_edge = np.where(inside[part, None], np.stack([table.rest_x[entry], table.rest_y[entry]], axis=1), 0.0)
        for a, b in np.ndindex(2, 2):
            virial[:, a, b] += gather(where, force[part, a] * rest_edge[:, b])
    del force, stress
    # shifted by integer repeats, independent of rounding at tile borders
    body_tile = index(np.floor((panel.body_rest - low) / tile) + np.rint(panel.body_origin / tile))
    touching = np.nonzero(r.pair_force > 0)[0]
    lever = pair_levers(r, touching)
    held_tile = number(panel.clamp_position[panel.held_clamp])
    held = r.held_forces
    for a, b in np.ndindex(2, 2):
        virial[:, a, b] += gather(body_tile[touching // 2], np.einsum("pk,pk->p", r.pair_nodal[touching, :, a], lever[..., b]))
        virial[:, a, b] += gather(held_tile, held[:, a] * panel.held_lever[:, b])
    share = panel.outline.cover(low, tile, shape)
    known = share >= LEAST_SHARE

    def shown(values: np.ndarray) -> np.ndarray:
        values = values.reshape(*shape, *values.shape[1:]).astype(float)
        values[~known] = np.nan
        return values

    pairs = 2.0 * gather(body_tile, np.ones(panel.body_count))
    active = gather(body_tile, pair_active(r).reshape(-1, 2).sum(axis=1).astype(float))
    moved = np.full((len(cloth.clasps), shape[0] * shape[1], 2), np.nan)
    moved[panel.body_clasp, body_tile] = r.body_u
    moved[:, ~known.ravel()] = np.nan
    turned = rotation(r.clamp_rotation)
    gradient = turned @ (r.gradient + _slopes(moved.reshape(-1, *shape, 2), tile))
    nominal = turned @ (shown(virial) / (np.maximum(share, LEAST_SHARE) * np.prod(tile))[..., None, None])
    tension = np.einsum("xyab,xycb->xyac", nominal, gradient) / np.linalg.det(gradient)[..., None, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        percent = shown(100.0 * active / pairs)
    gradient = np.where(known[..., None, None], gradient, np.nan)
    return PanelMap(low - middle, tile, share, gradient, nominal, tension, percent, shown(stress_max))


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
