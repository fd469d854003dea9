"""A small made-up mesh: six open zigzag wires, a closed one, and a body between neighbours at every second corner."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from warpknit.results.frame import Frame, WireLayout

OPEN_WIRES, NODES, CLOSED_NODES = 6, 41, 40
SPACING, HEIGHT = 1.0e-3, 8.0e-3  # [m]


@pytest.fixture
def layout() -> WireLayout:
    first = np.repeat(np.arange(OPEN_WIRES), 4)
    return WireLayout(
        wire_start=np.concatenate((np.arange(OPEN_WIRES + 1) * NODES, [OPEN_WIRES * NODES + CLOSED_NODES])),
        wire_closed=np.arange(OPEN_WIRES + 1) == OPEN_WIRES,
        period=np.array([OPEN_WIRES * SPACING, HEIGHT]),
        diameter=15e-6,
        body_radius=15e-6 / 8,
        body_wires=np.stack((first, first + 1), axis=1),
        rhombus_bodies=np.array([9, 10, 13, 14]),
    )


@pytest.fixture
def make_frame(layout: WireLayout) -> Callable[..., Frame]:
    def make(index: int, *, strain: float | None = None, shear: float = 0.0, stage: str = "load") -> Frame:
        strain = 0.02 * index if strain is None else strain
        wire = np.repeat(np.arange(layout.wire_count), np.diff(layout.wire_start))
        step = np.arange(layout.node_count) - layout.wire_start[wire]
        height = step / 40.0 * HEIGHT
        swing = 0.55 * SPACING * np.abs((step / 10.0) % 2.0 - 1.0) * np.where(wire % 2, 1.0, -1.0)
        position = np.stack((SPACING * wire + swing, height, 2e-5 * np.cos(step)), axis=1)
        body = np.stack((SPACING * (layout.body_wires[:, 0] + 0.5), np.tile(np.arange(4) * 2e-3 + 1e-3, OPEN_WIRES)), axis=1)
        deformation = np.array([[1.0 + strain, shear], [0.0, 1.0 + strain]])
        position[:, :2] = position[:, :2] @ deformation.T
        rank = np.arange(layout.body_count)
        force = np.repeat(np.maximum(0.0, 1e-5 * (strain * 100.0 - rank % 12)), 2)
        force[::8] += 3e-6  # some bodies rest on one wire only
        return Frame(
            index=index,
            stage=stage,
            load_factor=min(1.0, index / 5.0),
            strain_weft=strain,
            strain_warp=strain,
            shear=shear,
            temperature=293.15,
            node_position=position,
            node_stress=5e9 * strain * np.abs(np.sin(0.3 * step + wire)),
            body_position=np.concatenate((body @ deformation.T, np.zeros((layout.body_count, 1))), axis=1),
            pair_force=force,
            pair_active=force > 0.0,
        )

    return make


@pytest.fixture
def space_layout(layout: WireLayout) -> WireLayout:
    """The same wires in space."""
    return replace(layout, body_radius=0.0)


@pytest.fixture
def make_space_frame(make_frame: Callable[..., Frame]) -> Callable[..., Frame]:
    """A frame with contacts elsewhere, at nodes: by default as many as its index says."""

    def make(index: int, count: int | None = None) -> Frame:
        frame, contact = make_frame(index), np.arange(index if count is None else count)
        wires = np.stack([contact % 7, (contact + 1) % 7], axis=1)
        position = np.resize(frame.node_position[3::7], (contact.size, 3))
        return replace(frame, elsewhere_position=position, elsewhere_force=1e-5 * (1.0 + contact), elsewhere_wires=wires)

    return make
