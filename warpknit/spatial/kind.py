"""The spatial model by the names that every kind of model has (solve/model.py)."""

from . import description, trials
from .mechanics import SpatialWorlds as worlds
from .model import build_model as build_model
from .model import initial_state

__all__ = ["build_model", "description", "initial_state", "trials", "worlds"]
