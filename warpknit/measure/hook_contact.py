"""Forces and places of the contact of two hooked wires (mesh/hook_mesh.py)."""

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
    arc_left: float  # [m] rest arc length of the contact from the lower clamp
    arc_right: float
    ground_force: float  # [N] of spring or plane on the body; 0 for a free body
    body: np.ndarray  # (2,) [m]
    threshold: float  # [N] above which a contact is active

    @property
    def is_closed(self) -> bool:
        return min(self.force_left, self.force_right) > self.threshold
