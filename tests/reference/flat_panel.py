"""Maps of even tension and held edges, without a mesh."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from warpknit.measure.observables import PanelMap
from warpknit.mesh.rim import Rim
from warpknit.scene import Cord
from warpknit.scene.outline import Outline


def flat_map(outline: Outline, spacing: float, tension: np.ndarray) -> PanelMap:
    count = np.ceil(outline.size / spacing).astype(int)
    low = outline.low
    shape = tuple(count.tolist())
    everywhere = np.broadcast_to(tension, (*shape, 2, 2)).copy()
    return PanelMap(
        low=low, tile=outline.size / count, inside=np.ones(shape), gradient=np.broadcast_to(np.eye(2), (*shape, 2, 2)).copy(),
        nominal=everywhere, tension=everywhere, active_percent=np.zeros(shape), stress_max=np.zeros(shape),
    )  # fmt: skip


def held_rim(outline: Outline, spacing: float, given: np.ndarray | None = None, cord: Cord | None = None) -> Rim:
    count = round(outline.length / spacing)
    arc = outline.length * np.arange(count) / count
    given = np.ones(count, dtype=bool) if given is None else given
    return Rim(outline, arc, outline.place(arc), given, csr_matrix((0, count)), cord)
