"""Contacts by class: places of one shape (knit/cloth.py), which close together in a mesh of equal loops.

Where an equilibrium breaks the symmetry of the mesh, a part of a class is closed.
"""

from __future__ import annotations

import numpy as np

from ..knit.cloth import CLASS_NAMES
from . import pair_active
from .observables import MeshModel, Observables


def class_of_pair(model: MeshModel) -> np.ndarray:
    """[pair] number of its class; one class for all where nothing is knitted."""
    if model.cloth is None:
        return np.zeros(model.pair_count, dtype=np.int64)
    return np.repeat(model.cloth.classes[model.panel.body_clasp], 2)


def classes_of(model: MeshModel) -> dict[str, int]:
    """Pairs in each class of contact, by its name A, B; none of two hooked wires."""
    counts = np.bincount(class_of_pair(model)).tolist() if model.scene.hook is None else []
    return {CLASS_NAMES[number]: count for number, count in enumerate(counts) if count}


def active_percent(r: Observables, name: str) -> float | None:
    """Share of the active pairs of a class; None where the mesh has none of it."""
    pairs = _pairs(r, name)
    return None if pairs is None else 100.0 * float(np.mean(pair_active(r)[pairs]))


def median_force(r: Observables, name: str) -> float | None:
    """Contact force [N] that half of a class's pairs reach, the upper median; None without pairs."""
    pairs = _pairs(r, name)
    return None if pairs is None else float(np.sort(r.pair_force[pairs])[len(pairs) // 2])


def _pairs(r: Observables, name: str) -> np.ndarray | None:
    if r.model.scene.hook is not None:
        return None
    number, model = CLASS_NAMES.index(name), r.model
    if number > (0 if model.cloth is None else model.cloth.classes.max(initial=0)):
        return None
    pairs = np.flatnonzero(class_of_pair(model) == number)
    return pairs if len(pairs) else None
