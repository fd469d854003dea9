"""Contacts of wires on the host."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True)
class Contacts:
    """Contacts on the host; arrays [contact]. `first` and `second` are the first nodes of the two segments.

    Two contacts of the same segments with different shifts are contacts with different periodic images.

    A saddle between two contacts of a pair counts as a contact with a negative force (kernels/wire_weights.py).
    """

    first: np.ndarray
    second: np.ndarray
    place: np.ndarray  # (contact, 2) on the segments, 0 .. 1
    shift: np.ndarray  # (contact, 3) [m] at rest, periodic shift of the second segment next to the first
    force: np.ndarray  # [N] normal
    friction: np.ndarray  # (contact, 3) [N] on the first
    normal: np.ndarray  # (contact, 3) towards the first
    overlap: np.ndarray  # [m] negative: gap

    @staticmethod
    def joined(parts: Sequence[Contacts]) -> Contacts:
        """Contacts of all parts in sequence."""
        if len(parts) == 1:
            return parts[0]
        return Contacts(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Contacts)))
