"""Parts of a loop: head, legs, feet, and the underlap to the next loop.

Heights are in course spacings above the foot line of the course. The head lies above HEAD. From the head outwards, the foot
begins where the leg comes below FOOT, and the underlap where the wire leaves the foot line: downwards before the loop, upwards
behind it.
"""

from __future__ import annotations

import numpy as np

from .cloth import Cloth

HEAD, FOOT = 1.0, 0.2  # [C]


def part_of_loop(cloth: Cloth, thread: int, arc: float) -> str:
    """The part of a loop, in words, at a plan arc length [m] of a thread: "head of a closed loop"."""
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
    """Part at the end of a path from the head outwards, to the entry of the loop or (not `before`) its exit.

    height: (sample,) [C] along the path.
    """
    low = np.flatnonzero(height < FOOT)
    if not len(low):
        return "head" if height[-1] > HEAD else "leg"
    beyond = height[low[0] :]
    return "underlap" if np.any(beyond < -FOOT if before else beyond > FOOT) else "foot"
