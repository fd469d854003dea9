"""The contact of two hooked planar wires."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure import active_threshold
from ..measure.observables import HookContact
from ..mesh.hook_mesh import LEFT, RIGHT, RIGHT_TOP


def hook_contact(r: Any) -> HookContact:
    """The contact of a hook."""
    model, panel = r.model, r.model.panel
    height = model.scene.hook.height if model.scene.hook is not None else 0.0
    # the first node is one spacing before the lower clamp
    local = panel.pair_seed - panel.wire_first[panel.pair_wire] + r.pair_slide - 1
    arc = (local + r.pair_u) * model.table.spacing[panel.pair_wire]
    at_clamps = np.zeros((len(panel.clamp_position), 2))
    np.add.at(at_clamps, panel.held_clamp, r.held_forces)
    on_wires = r.pair_nodal[r.pair_force > 0.0].sum(axis=(0, 1))
    return HookContact(
        displacement=float(r.gradient[0, 1]) * height,
        drive_force=-float(at_clamps[RIGHT_TOP, 0]),
        force_left=float(r.pair_force[LEFT]),
        force_right=float(r.pair_force[RIGHT]),
        arc_left=float(arc[LEFT]),
        arc_right=float(arc[RIGHT]),
        # both pairs of a single contact point act on wires, with opposite forces
        ground_force=float(np.hypot(*on_wires)) if model.treatment.anchored else 0.0,
        body=r.body_position[0, :2],
        threshold=active_threshold(model),
    )
