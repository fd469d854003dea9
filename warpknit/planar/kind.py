"""The planar model by the names that every kind of model has (solve/model.py)."""

from __future__ import annotations

from collections.abc import Sequence

from ..mechanics.protocols import Group
from .description import accuracy, contacts, limitations, overlaps_as_knitted, physics
from .mechanics import PlanarMechanics
from .model import Model, build_model
from .replicas import ReplicaGroup
from .state import State, initial_state
from .trials import fine, reference, settings, varied

__all__ = [
    "accuracy",
    "build_model",
    "contacts",
    "fine",
    "initial_state",
    "limitations",
    "overlaps_as_knitted",
    "physics",
    "reference",
    "settings",
    "varied",
    "worlds",
]


def worlds(models: Sequence[Model], state: State | None = None) -> Group:
    """Worlds of one topology; a state belongs to a single one."""
    if len(models) > 1:
        return ReplicaGroup(models[0], len(models))
    return PlanarMechanics(models[0], initial_state(models[0]) if state is None else state).group
