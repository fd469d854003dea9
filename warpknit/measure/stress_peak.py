"""Place of the largest wire stress: wire, arc, and part of the loop.

Heights in a loop are in course spacings above the foot line of the course. The head lies above HEAD. From the head outwards,
the foot begins where the leg comes below FOOT, and the underlap where the wire leaves the foot line: downwards before the loop,
upwards behind it.
"""

from __future__ import annotations

import numpy as np

from ..knit.cloth import Cloth
from .observables import Observables

HEAD, FOOT = 1.0, 0.2  # [C]


def part_of_loop(cloth: Cloth, thread: int, arc: float) -> str:
    """Part of a loop at a plan arc length [m] of a thread, in words: "head of a closed loop"."""
    line = cloth.threads[thread]
    count = len(line.points)
    here = int(np.floor(arc / line.spacing)) % count
    stitch = cloth.stitches[line.stitch[here]]
    if stitch.kind == "inlay":
        return "inlay"
    own = line.stitch == line.stitch[here]
    starts = np.flatnonzero(own & ~np.roll(own, 1))
    start = int(starts[0]) if len(starts) else 0
    if start + np.count_nonzero(own) > count:
        start -= count  # a loop begins before its thread does, with half an underlap
    samples = start + np.arange(np.count_nonzero(own), dtype=np.float64)
    height = line.at(samples * line.spacing, cloth.size[1])[:, 1] * cloth.courses / cloth.size[1] - stitch.course
    place, head = (here - start) % count, int(np.argmax(height))
    from_head = height[place : head + 1][::-1] if place < head else height[head : place + 1]
    return f"{_part(from_head, before=place < head)} of {'an' if stitch.kind == 'open' else 'a'} {stitch.kind} loop"


def _part(height: np.ndarray, *, before: bool) -> str:
    """Part between head and entry, or (not `before`) exit of the loop. height: (sample,) [C] along the path."""
    low = np.flatnonzero(height < FOOT)
    if not len(low):
        return "head" if height[-1] > HEAD else "leg"
    beyond = height[low[0] :]
    return "underlap" if np.any(beyond < -FOOT if before else beyond > FOOT) else "foot"


def peak_node(r: Observables) -> int:
    """Node with the largest stress, or the node before its place."""
    stress = r.wire_stress
    node, place = int(np.argmax(stress.node)), int(np.argmax(stress.contact)) if len(stress.contact) else -1
    return int(stress.contact_node[place]) if place >= 0 and stress.contact[place] > stress.node[node] else node


def peak_wire(r: Observables) -> int:
    """The wire of `peak_node`."""
    return int(np.searchsorted(r.model.layout().wire_start, peak_node(r), side="right") - 1)


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
    wire = peak_wire(r)
    first, end = model.layout().wire_start[wire : wire + 2]
    panel = model.panel
    begin = panel.wire_begin[wire] if len(panel.wire_begin) else 0.0
    share = (node - first) / max(1, end - first - (not panel.wire_closed[wire]))
    return part_of_loop(model.cloth, int(panel.wire_thread[wire]), float(begin + share * panel.wire_length[wire]))
