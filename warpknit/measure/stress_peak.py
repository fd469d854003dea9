"""Where the wires carry their largest stress: the wire, the place on it, and the part of the loop."""

from __future__ import annotations

import numpy as np

from ..knit.loop_parts import part_of_loop
from .observables import MeshModel, Observables


def peak_node(r: Observables) -> int:
    """The node with the largest stress, or the one before it where the stress is largest between two nodes."""
    stress = r.wire_stress
    node, place = int(np.argmax(stress.node)), int(np.argmax(stress.contact)) if len(stress.contact) else -1
    return int(stress.contact_node[place]) if place >= 0 and stress.contact[place] > stress.node[node] else node


def wire_of(model: MeshModel, node: int) -> int:
    """The wire of a node."""
    return int(np.searchsorted(model.layout().wire_start, node, side="right") - 1)


def peak_position(r: Observables) -> np.ndarray:
    """(2,) [m] weft and warp position of `peak_node` from the corner of the mesh; of a periodic one within its tile."""
    place = np.asarray(r.node_position[peak_node(r), :2] - r.corner[:2])
    if r.model.panel.boundary != "periodic":
        return place
    tile = r.stretch @ np.diag(r.model.panel.size)
    return np.asarray(tile @ (np.linalg.solve(tile, place) % 1.0))


def peak_part(r: Observables) -> str | None:
    """Part of the loop at `peak_node`, in words; None where nothing is knitted."""
    model, node = r.model, peak_node(r)
    if model.cloth is None:
        return None
    wire = wire_of(model, node)
    first, end = model.layout().wire_start[wire : wire + 2]
    panel = model.panel
    begin = panel.wire_begin[wire] if len(panel.wire_begin) else 0.0
    share = (node - first) / max(1, end - first - (not panel.wire_closed[wire]))
    return part_of_loop(model.cloth, int(panel.wire_thread[wire]), float(begin + share * panel.wire_length[wire]))
