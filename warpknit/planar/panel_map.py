"""The virial of a gripped planar panel, tile by tile, for its map (measure/tiles.py)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure.observables import PanelMap
from ..measure.tiles import Tiles, panel_map_of
from .host_state import pair_levers

NODES_AT_ONCE = 1_000_000


def find_panel_map(r: Any) -> PanelMap:
    """The map of a gripped panel."""
    panel, table = r.model.panel, r.model.table
    tiles = Tiles.of(r.model)
    virial, stress_max = tiles.zeros(2, 2), tiles.zeros()
    force, stress = r.segment_force, r.wire_stress.node
    inside = np.any(r.edge != 0.0, axis=1)
    origin = np.repeat(np.arange(len(panel.block_first)), panel.block_count)
    for begin in range(0, panel.node_count, NODES_AT_ONCE):
        part = slice(begin, begin + NODES_AT_ONCE)
        entry = r.entry[part]
        where = tiles.at(np.stack([table.x[entry], table.y[entry]], axis=1) + panel.block_origin[origin[part]])
        np.maximum.at(stress_max, where, stress[part])
        rest_edge = np.where(inside[part, None], np.stack([table.rest_x[entry], table.rest_y[entry]], axis=1), 0.0)
        tiles.add(virial, where, np.einsum("na,nb->nab", force[part], rest_edge))
    del force, stress
    touching = np.nonzero(r.pair_force > 0)[0]
    lever = np.einsum("pka,pkb->pab", r.pair_nodal[touching], pair_levers(r, touching))
    tiles.add(virial, tiles.of_body[touching // 2], lever)
    held = np.einsum("na,nb->nab", r.held_forces, panel.held_lever)
    tiles.add(virial, tiles.at(panel.clamp_position[panel.held_clamp]), held)
    return panel_map_of(r, tiles, virial, stress_max, r.body_u)
