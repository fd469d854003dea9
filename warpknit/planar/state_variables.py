"""Fields of a planar mesh that are transferred between meshes of one knit (warpknit/mechanics/)."""

from __future__ import annotations

import numpy as np

from .host_state import read_strip
from .join import Join
from .model import Model
from .state import State


def state_variables(model: Model, state: State) -> dict[str, np.ndarray]:
    """Variables of a state of the global mesh, on all ranks.

    [node] and [body] displacements [m], [node] tension [N] and softened strain, [pair] offset [N].
    """
    host = read_strip(model, state)
    offset = state.tension_offset.numpy().astype(np.float64)
    strain = (host.tension - offset) / np.repeat(host.wire_axial, model.panel.wire_count)
    join = Join(model, everywhere=True)
    of_nodes = {"x": host.u[:, 0], "y": host.u[:, 1], "tension": host.tension, "strain": strain}
    of_bodies = {"body_x": host.body_u[:, 0], "body_y": host.body_u[:, 1]}
    return {
        **{name: join.nodes(values) for name, values in of_nodes.items()},
        **{name: join.bodies(values) for name, values in of_bodies.items()},
        "body_offset": join.pairs(host.pair_offset),
    }
