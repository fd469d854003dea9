"""The virial of a gripped panel in space, tile by tile, for its map (measure/tiles.py)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure.observables import PanelMap
from ..measure.tiles import Tiles, panel_map_of
from .rest_curve import rest_place


def find_panel_map(r: Any) -> PanelMap:
    """The map of a gripped panel."""
    rods, wires, touching = r.model.rods, r.model.wires, r.touching
    tiles = Tiles.of(r.model)
    virial, stress_max = tiles.zeros(2, 2), tiles.zeros()
    here = tiles.at(rods.position[:, :2])
    np.maximum.at(stress_max, here, r.wire_stress.node)
    tiles.add(virial, here, np.einsum("na,nb->nab", r.segment_force[:, :2], rods.rest_edge[:, :2]))
    place = rest_place(rods, r.model.curve, touching.first, touching.place[:, 0])
    other = rest_place(rods, r.model.curve, touching.second, touching.place[:, 1]) + touching.shift
    push = touching.force[:, None] * touching.normal + touching.friction
    tiles.add(virial, tiles.at(place[:, :2]), np.einsum("ca,cb->cab", push[:, :2], (other - place)[:, :2]))
    held = np.einsum("na,nb->nab", r.force[wires.held_node, :2], wires.held_lever)
    tiles.add(virial, here[wires.held_node], held)
    return panel_map_of(r, tiles, virial, stress_max, _moved(r))


def _moved(r: Any) -> np.ndarray:
    """(site, 2) [m] displacement of the wires at each site from the affine prediction, the mean of both wires."""
    rods, wires = r.model.rods, r.model.wires
    last = rods.wire_count[wires.site_wire] - 1
    seed = np.clip(wires.site_seed, 0, last)
    segment = np.minimum(seed.astype(np.int64), last - 1)
    node, place = (rods.wire_first[wires.site_wire] + segment).ravel(), (seed - segment).ravel()
    rest = rest_place(rods, r.model.curve, node, place)[:, :2]
    now = (r.position[node] + r.curve.offset(node, place))[:, :2]
    return np.asarray((now - rest @ r.gradient.T).reshape(-1, 2, 2).mean(axis=1))
