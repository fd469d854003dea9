"""Places where wires from a file may touch: where they hook, and where else they cross in plan view.

A knit has contact at its clasps. Wires from a file need not be knitted: in a weave every crossing carries a force. So each
crossing that bounds no hook is a place of its own. Wires that cross farther apart than a layer of the mesh is thick are in
different layers, which strains in the plane do not bring together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warpknit.wires.centre_lines import Wires
from warpknit.wires.hooks import find_crossings, hooks_of

LAYER = 0.15  # of the wire of a loop, half the size of a loop: wires that cross farther apart are in different layers


@dataclass(frozen=True)
class Places:
    """Hooks first, then the other crossings; [place]."""

    wire: np.ndarray  # (place, 2) from 0
    low: np.ndarray  # (place, 2) [m] where the lens of a hook begins along either wire; of a crossing where it is
    high: np.ndarray  # (place, 2) [m]
    position: np.ndarray  # (place, 2) [m] in plan view
    hooks: int
    crowded: bool = False  # too many crossings to search

    def __len__(self) -> int:
        return len(self.wire)

    def line(self) -> str:
        """The same in words."""
        if self.crowded:
            return "not searched: too many crossings in plan view"
        crossings = len(self) - self.hooks
        others = f"{crossings:,} {'other ' * (self.hooks > 0)}crossing{'s' * (crossings != 1)}"
        if not self.hooks:
            return f"no wires hook each other; {others}"
        hooks = f"{self.hooks:,} places where two wires hook each other"
        return f"{hooks}; {others}" if crossings else hooks


def find_places(wires: Wires, loop_length: float) -> Places:
    """The places of wires with about so much wire [m] in a loop; each once."""
    crossings = find_crossings(wires)
    hooks = hooks_of(wires, crossings, loop_length)
    if crossings is None:
        return Places(hooks.wire, hooks.low, hooks.high, hooks.position, 0, crowded=True)
    number, first = np.unique(crossings.number, return_index=True)
    is_place = ~np.isin(number, hooks.corner) & (crossings.gap[first] <= LAYER * loop_length)
    other = first[is_place]
    return Places(
        np.concatenate([hooks.wire, crossings.wire[other]]),
        np.concatenate([hooks.low, crossings.arc[other]]),
        np.concatenate([hooks.high, crossings.arc[other]]),
        np.concatenate([hooks.position, crossings.position[other]]),
        len(hooks),
    )
