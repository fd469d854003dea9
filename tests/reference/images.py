"""Checks of pictures, and runs without them."""

import io
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


def check_image(path: Path) -> np.ndarray:
    image = matplotlib.image.imread(path)
    assert min(image.shape[:2]) > 400 and np.ptp(image[..., :3]) > 0.9
    border = np.concatenate((image[0], image[-1], image[:, 0], image[:, -1]))
    assert np.all(border[..., :3] == 1.0)  # nothing is cut off at the edge
    return image


def draw_blank(patch: pytest.MonkeyPatch) -> None:
    """From now on figures are made, but neither laid out nor drawn: their files are an image of one pixel.

    Drawing takes longer than a small run. Modules that look at pictures use the fixture `pictures`.
    """
    draw, pixel = FigureCanvasAgg.print_png, io.BytesIO()
    matplotlib.image.imsave(pixel, np.zeros((1, 1, 3)), format="png")

    def print_png(self: FigureCanvasAgg, path: Path, *arguments: object, **options: object) -> None:
        if "draw" in vars(self.figure):  # Matplotlib asks for a renderer
            draw(self, path, *arguments, **options)
        else:
            Path(path).write_bytes(pixel.getvalue())

    patch.setattr(FigureCanvasAgg, "print_png", print_png)
    patch.setattr(Figure, "draw_without_rendering", lambda self: None)
