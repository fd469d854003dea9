"""One time step of a single mode, as a matrix."""

import numpy as np


def step_matrix(phase: float, look_ahead: float) -> np.ndarray:
    """One step of (q, dt v) of a mode with w dt = phase (kernels/control.py)."""
    k = phase**2
    return np.array([[1 - (1 + look_ahead) * k, 1.0], [-k, 1.0]])
