"""The planar model by the names that every kind of model has (solve/model.py)."""

from __future__ import annotations

from .description import accuracy, contacts, limitations, overlaps_as_knitted, physics
from .mechanics import PlanarWorlds as worlds
from .model import build_model
from .probe_settings import fine, reference, settings, varied
from .state import initial_state

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
