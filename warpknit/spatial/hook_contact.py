"""Contact of two hooked wires in space, by the names of measure/observables.py.

The wires wind round each other and touch in two or three places, whose forces have opposite components out of the plane. The
contact force is their sum; its place along a wire is their mean, weighted by the in-plane component along that sum.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure import active_threshold
from ..measure.observables import HookContact
from ..mesh.hook_mesh import LEFT, RIGHT, RIGHT_TOP
from .hook_wires import BETWEEN


def hook_contact(r: Any) -> HookContact:
    """The contact of a hook; without contact, its places are at the middle of the lens at rest."""
    model, t = r.model, r.touching
    hook, rods = model.scene.hook, model.rods
    assert hook is not None
    step = hook.length / model.scene.model.nodes_per_loop
    push = t.force[:, None] * t.normal + t.friction  # on the left wire, whose nodes come first
    total = push.sum(axis=0)
    force = float(np.linalg.norm(total))
    arc = {wire: float(model.wires.site_seed[0, wire] + BETWEEN) * step for wire in (LEFT, RIGHT)}
    body = np.array([0.0, 0.5 * hook.height])
    if force > 0.0:
        share = (push[:, :2] @ total[:2]).clip(0.0)
        share = share / share.sum()
        for wire, nodes, place in ((LEFT, t.first, t.place[:, 0]), (RIGHT, t.second, t.place[:, 1])):
            arc[wire] = float(share @ (nodes - rods.wire_first[wire] + place - BETWEEN)) * step
        touched = r.position[t.first] + r.curve.offset(t.first, t.place[:, 0])
        body = share @ (touched - 0.5 * rods.section.thickness * t.normal)[:, :2]
    held = model.wires.held_node.reshape(-1, 2)[RIGHT_TOP]
    return HookContact(
        displacement=float(r.gradient[0, 1]) * hook.height,
        drive_force=-float(r.force[held, 0].sum()),
        force_left=force,
        force_right=force,
        arc_left=arc[LEFT],
        arc_right=arc[RIGHT],
        ground_force=0.0,
        body=body,
        threshold=active_threshold(r.model),
    )
