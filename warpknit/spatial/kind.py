"""The spatial model by the names that every kind of model has (model.py)."""

from . import estimate, trials
from .mechanics import SpatialMechanics as mechanics
from .mesh import build_mesh as build_model
from .mesh import initial_state

__all__ = ["build_model", "estimate", "initial_state", "mechanics", "trials"]
