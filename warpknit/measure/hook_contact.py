"""What two hooked wires show: forces and places of their contact, in the words of mesh/hook_mesh.py."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class HookContact:
    """One state of a hook."""

    displacement: float  # [m] of the driven end
    drive_force: float  # [N] that holds it there, sideways
    force_left: float  # [N] between body and left wire
    force_right: float
    arc_left: float  # [m] of the place nearest to the body, along the wire at rest, from the lower clamp
    arc_right: float
    ground_force: float  # [N] that spring or plane take from the body; 0 where it is free
    body: np.ndarray  # (2,) [m]
    threshold: float  # [N] above which a contact counts as one

    @property
    def is_closed(self) -> bool:
        return min(self.force_left, self.force_right) > self.threshold
