"""Two concentric rings with bodies squeezed between them, and a deformed state of them."""

import numpy as np

from reference.plane_wires import Rig, circle, panel_of_wires, table_of_wires
from warpknit.kernels.contact import CURVE_COEFFICIENTS
from warpknit.mesh.rest_table import Table

NODES = 40
RADIUS = 0.4e-3
SPACING = 2 * np.pi * RADIUS / NODES
DEPTH = 1e-6  # [m] of the bodies in either wire
PENALTY = 1e5  # [N/m]


def two_rings(bodies: int, device: str = "cpu", **solver: object) -> Rig:
    """Two concentric rings with bodies squeezed between them, and contact curves bent at random by up to 1 % of a segment."""
    random = np.random.default_rng(1)
    reach = 0.625 * 15e-6
    gap = 2 * (reach - DEPTH)
    table = table_of_wires([circle(RADIUS, NODES), circle(RADIUS + gap, NODES)], closed=True)
    curve = random.uniform(-1, 1, (2 * NODES, CURVE_COEFFICIENTS)) * ([0.02] * 2 + [0.1] * (CURVE_COEFFICIENTS - 2))
    period = [np.mod(np.arange(-table.lead, NODES + table.lead), NODES) + w * NODES for w in range(2)]
    table = Table(**{**vars(table), "curve": curve[np.concatenate(period)]})
    turn = 2 * np.pi * (np.arange(bodies) / max(bodies, 1) + 0.013 * np.arange(bodies))
    place = (RADIUS + gap / 2) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    segment = np.floor(turn / (2 * np.pi) * NODES).astype(int)
    pairs = [pair for s in segment for pair in ((0, int(s), -1), (1, int(s), 1))]
    rig = Rig(table, panel_of_wires(table, closed=True, bodies=place, pairs=pairs), device, **solver)
    rig.control(contact_stiffness=PENALTY)
    return rig


def deformed(rig: Rig) -> np.ndarray:
    """A state with random stretches of 1 % and turnings of 0.02."""
    random = np.random.default_rng(2)
    move = np.concatenate([np.full(rig.nodes, 0.01 * SPACING), np.full(len(rig.rest) - rig.nodes, 0.3 * DEPTH)])
    return rig.rest + move[:, None] * random.uniform(-1, 1, rig.rest.shape)
