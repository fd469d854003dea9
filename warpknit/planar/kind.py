"""The planar model by the names that every kind of model has (solve/model.py)."""

from __future__ import annotations

from collections.abc import Sequence

from ..mechanics.protocols import Group
from . import description, trials
from .mechanics import PlanarMechanics
from .model import Model, build_model
from .replicas import ReplicaGroup
from .state import State, initial_state

__all__ = ["build_model", "description", "initial_state", "trials", "worlds"]


def worlds(models: Sequence[Model], state: State | None = None) -> Group:
    """Worlds of one topology; a state belongs to a single one."""
    if len(models) > 1:
        return ReplicaGroup(models[0], len(models))
    return PlanarMechanics(models[0], initial_state(models[0]) if state is None else state).group
