"""scene.usda in Blender, as tools/render_blender.py renders it.

Blender's package `bpy` pins an old NumPy, so it has an environment of its own: WARPKNIT_BPY_PYTHON names its Python; without, one
is made in pytest's cache, from the package index.
"""

import os
import subprocess
import sys
import venv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from warpknit.export.usd.writer import StageWriter
from warpknit.results.frame import Frame, WireLayout

TOOL = Path(__file__).parents[2] / "tools" / "render_blender.py"
LIMIT = 4e8  # [Pa] stress of the darkest colour: the largest of the mesh
pytestmark = pytest.mark.usefixtures("pictures")
BACKGROUND = 0.02  # of a colour: nearer to the corner of the picture is background
WHITE_PLANE = """
import sys
sys.path.insert(0, sys.argv[3])
import bpy, render_blender
render_blender.import_scene(sys.argv[1])
bpy.ops.mesh.primitive_plane_add(size=1000, location=(0, 0, -1))
white = bpy.data.materials.new("white")
white.use_nodes = True
shader = white.node_tree.nodes["Principled BSDF"].inputs
shader["Base Color"].default_value = (1, 1, 1, 1)
shader["Roughness"].default_value, shader["Specular IOR Level"].default_value = 1, 0
bpy.context.object.data.materials.append(white)
render_blender.render(sys.argv[2], frame=None, size=(160, 120))
"""


@pytest.fixture(scope="module")
def blender(request: pytest.FixtureRequest) -> str:
    """A Python that has bpy."""
    named = os.environ.get("WARPKNIT_BPY_PYTHON")
    if named:
        return named
    home = request.config.cache.mkdir("bpy")
    python = home / "bin" / "python"
    if not python.exists():
        venv.create(home, with_pip=True)
    done = subprocess.run([python, "-m", "pip", "install", "-q", "bpy"], check=False, capture_output=True, text=True)
    if done.returncode:
        version = ".".join(map(str, sys.version_info[:2]))
        pytest.skip(f"no bpy for Python {version} from the package index: {done.stderr.strip().splitlines()[-1]}")
    return str(python)


@pytest.fixture
def stage(tmp_path: Path, layout: WireLayout, make_frame: Callable[..., Frame]) -> Path:
    thick = replace(layout, diameter=1e-4)  # of several pixels
    writer = StageWriter(tmp_path, thick, scene_name="zigzag", scene_hash="0", version="1.0", colour_stress_max=LIMIT)
    for index in range(3):
        writer.add_frame(make_frame(index, strain=0.04 * index))
    writer.close(complete=True)
    return writer.path


def picture(python: str, *arguments: str | Path) -> np.ndarray:
    done = subprocess.run([python, *map(str, arguments)], check=False, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return imread(arguments[2])[..., :3]


@pytest.mark.slow
def test_a_render_shows_wires_in_the_colours_of_their_stress(tmp_path: Path, stage: Path, blender: str) -> None:
    """Light in the background; wires from gold (red above blue) to violet, so not all of one hue; active contacts red."""
    image = picture(blender, TOOL, stage, tmp_path / "a.png", "--size", "480", "360")
    assert image.mean() > 0.3
    drawn = image[np.abs(image - image[0, 0]).max(axis=-1) > BACKGROUND]
    assert len(drawn) > 1e-3 * image[..., 0].size
    warmth = drawn[:, 0] - drawn[:, 2]
    assert np.percentile(warmth, 95) > 0.2 and np.ptp(warmth) > 0.3


@pytest.mark.slow
def test_a_white_plane_is_bright_and_not_burnt_out(tmp_path: Path, stage: Path, blender: str) -> None:
    """Radiance DOME + 4 KEY cos(angle)/pi = 0.4 + 0.38 as Blender takes the lights: 0.78, or 0.9 of the scale of a picture."""
    script = tmp_path / "plane.py"
    script.write_text(WHITE_PLANE)
    image = picture(blender, script, stage, tmp_path / "b.png", TOOL.parent)
    assert np.median(image) == pytest.approx(0.9, abs=0.08)


@pytest.mark.slow
def test_contacts_elsewhere_are_blue_in_the_records_that_have_some(
    tmp_path: Path, space_layout: WireLayout, make_space_frame: Callable[..., Frame], blender: str
) -> None:
    """And a record without any, as the last one here, is rendered: Cycles ends at points that are empty."""
    layout = replace(space_layout, diameter=1e-4)
    writer = StageWriter(tmp_path, layout, scene_name="zigzag", scene_hash="0", version="1.0", colour_stress_max=LIMIT)
    for index, count in enumerate((0, 40, 0)):
        writer.add_frame(make_space_frame(index, count))
    writer.close(complete=True)
    for frame, shows in ((1, True), (2, False)):
        image = picture(blender, TOOL, writer.path, tmp_path / f"{frame}.png", "--size", "240", "180", "--frame", str(frame))
        is_blue = image[..., 2] > image[..., 0] + 0.2
        assert is_blue.any() == shows
