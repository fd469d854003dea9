"""Checks of pictures, and runs without them."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg


def check_image(path: Path) -> np.ndarray:
    image = matplotlib.image.imread(path)
    assert min(image.shape[:2]) > 400 and np.ptp(image[..., :3]) > 0.9
    border = np.concatenate((image[0], image[-1], image[:, 0], image[:, -1]))
    assert np.all(border[..., :3] == 1.0)  # nothing is cut off at the edge
    return image


def draw_blank(patch: pytest.MonkeyPatch) -> None:
    """From now on figures are laid out, but their files are an image of one pixel: drawing takes longer than a small run."""
    draw = FigureCanvasAgg.print_png

    def print_png(self: FigureCanvasAgg, path: Path, *arguments: object, **options: object) -> None:
        if "draw" in vars(self.figure):  # Matplotlib asks for a renderer, to lay the figure out
            draw(self, path, *arguments, **options)
        else:
            matplotlib.image.imsave(path, np.zeros((1, 1, 3)), format="png")

    patch.setattr(FigureCanvasAgg, "print_png", print_png)
