"""Maps over a gripped panel: strain, tension, active contacts and stress of each repeat of the knit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST_SHARE = 0.5  # smallest share of a tile inside the outline with values


@dataclass(frozen=True)
class PanelMap:
    """Values on tiles (column, row); nan where less than LEAST_SHARE of the tile is mesh."""

    low: np.ndarray  # (2,) [m] lower corner of the first tile, from the centre of the panel at rest
    tile: np.ndarray  # (2,) [m] size of a tile at rest
    inside: np.ndarray  # share of the tile inside the outline
    gradient: np.ndarray  # (column, row, 2, 2) deformation gradient
    nominal: np.ndarray  # (column, row, 2, 2) [N/m] force per rest width
    tension: np.ndarray  # (column, row, 2, 2) [N/m] force per current width
    active_percent: np.ndarray  # of the pairs of the tile
    stress_max: np.ndarray  # [Pa]

    @property
    def known(self) -> np.ndarray:
        """Whether a tile has values."""
        return self.inside >= LEAST_SHARE

    @property
    def place(self) -> np.ndarray:
        """(column, row, 2) [m] centre of each tile, from the centre of the panel at rest."""
        column, row = np.indices(self.inside.shape)
        return self.low + (np.stack([column, row], axis=-1) + 0.5) * self.tile

    def area_share(self, below: np.ndarray) -> float:
        """Share of the area with values where a condition (column, row) holds."""
        area = np.where(self.known, self.inside, 0.0)
        return float(area[below & self.known].sum() / area.sum())
