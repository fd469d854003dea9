"""What is measured of two hooked wires: forces and places of their contact, in the words of hook.py."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mesh.hook import LEFT, RIGHT, RIGHT_TOP
from . import measures as whole
from .observables import PlanarObservables


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


def hook_contact(r: PlanarObservables) -> HookContact:
    """The contact of a hook's reading."""
    model, panel = r.model, r.model.panel
    height = model.scene.hook.height if model.scene.hook is not None else 0.0
    # the first node is one spacing before the lower clamp
    local = panel.pair_seed - panel.wire_first[panel.pair_wire] + r.pair_slide - 1
    arc = (local + r.pair_u) * model.table.spacing[panel.pair_wire]
    at_clamps = np.zeros((len(panel.clamp_position), 2))
    np.add.at(at_clamps, panel.held_clamp, whole.held_forces(r))
    on_wires = r.pair_nodal[r.pair_force > 0.0].sum(axis=(0, 1))
    return HookContact(
        displacement=float(r.gradient[0, 1]) * height,
        drive_force=-float(at_clamps[RIGHT_TOP, 0]),
        force_left=float(r.pair_force[LEFT]),
        force_right=float(r.pair_force[RIGHT]),
        arc_left=float(arc[LEFT]),
        arc_right=float(arc[RIGHT]),
        # of a single contact point both pairs act on wires, and what one gives the other takes
        ground_force=float(np.hypot(*on_wires)) if model.treatment.anchored else 0.0,
        body=whole.positions(r)[1][0, :2],
        threshold=whole.active_threshold(model),
    )
