"""The planar model under the common names of all kinds of model (model.py)."""

from . import description, trials
from .mechanics import PlanarMechanics as mechanics
from .model import build_model
from .replicas import ReplicaGroup as replicas
from .state import initial_state

__all__ = ["build_model", "description", "initial_state", "mechanics", "replicas", "trials"]
