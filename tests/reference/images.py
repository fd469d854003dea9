"""Checks of pictures."""

from pathlib import Path

import matplotlib.image
import numpy as np


def check_image(path: Path) -> np.ndarray:
    image = matplotlib.image.imread(path)
    assert min(image.shape[:2]) > 400 and np.ptp(image[..., :3]) > 0.9
    border = np.concatenate((image[0], image[-1], image[:, 0], image[:, -1]))
    assert np.all(border[..., :3] == 1.0)  # nothing is cut off at the edge
    return image
