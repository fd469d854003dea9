"""Files that were damaged, by bytes and by words, and files of chance: what comes back is wires or one line, nothing else."""

import numpy as np
import pytest
import wire_samples as samples
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Sdf, Tf, Usd

from warpknit.base.errors import SceneError
from warpknit.wires.bases import BadFile
from warpknit.wires.file_curves import curves_of
from warpknit.wires.overlaps import find_overlaps
from warpknit.wires.read import _wires, read_wires
from warpknit.wires.stage_process import stage_arrays

SUFFIXES = (".bcc", ".csv", ".npz", ".pyp")
WORDS = ["nan", "inf", "-1", "0", "1e308", "1e-320", "99999999999999999999", "", "x", "*E", "*Q", "#", ";", "\x00", "é", "[mm]"]
EXAMPLES = 60

damage = st.lists(
    st.one_of(
        st.tuples(st.just("byte"), st.floats(0.0, 1.0), st.integers(0, 255)),
        st.tuples(st.just("cut"), st.floats(0.0, 1.0), st.just(0)),
        st.tuples(st.just("remove"), st.floats(0.0, 1.0), st.integers(1, 40)),
        st.tuples(st.just("double"), st.floats(0.0, 1.0), st.integers(1, 40)),
    ),
    min_size=1,
    max_size=4,
)
words = st.lists(st.tuples(st.floats(0.0, 1.0), st.sampled_from(WORDS)), min_size=1, max_size=3)


def damaged(data: bytes, changes) -> bytes:
    for kind, share, value in changes:
        place = int(share * len(data))
        if kind == "byte":
            data = data[:place] + bytes([value]) + data[place + 1 :]
        elif kind == "cut":
            data = data[:place]
        elif kind == "remove":
            data = data[:place] + data[place + value :]
        else:
            data = data[: place + value] + data[place:]
    return data


def reworded(text: str, changes) -> str:
    for share, word in changes:
        parts = text.replace(",", " , ").replace("(", " ( ").split(" ")
        parts[int(share * (len(parts) - 1))] = word
        text = " ".join(parts)
    return text


def check_wires(wires) -> None:
    """What holds of wires whatever they are."""
    assert len(wires.points) == len(wires.kinds) == len(wires.shifts) > 0
    for points, kind in zip(wires.points, wires.kinds, strict=True):
        assert points.ndim == 2 and points.shape[1] == 3 and len(points) >= 3 and np.isfinite(points).all()
        assert kind in ("open", "closed", "periodic")
    assert (wires.lengths > 0.0).all() and np.isfinite(wires.lengths).all()
    overlaps = find_overlaps(wires, 1e-5)
    assert "\n" not in overlaps.line()


def check_file(path, **options) -> None:
    """Wires or one line."""
    try:
        wires = read_wires(path, node_spacing=1e-3, **options)
    except SceneError as error:
        assert str(error).startswith(f"{path}: wires.") and "\n" not in str(error)
    else:
        check_wires(wires)


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    """Bytes of a good file of each format, and a folder to write to."""
    folder = tmp_path_factory.mktemp("fuzz")
    short = [points[::3] for points in samples.patch()[:2]]
    samples.write_bcc(folder / "a.bcc", short)
    samples.write_csv(folder / "a.csv", short)
    samples.write_npz(folder / "a.npz", short)
    samples.write_cell(folder / "a.pyp")
    samples.write_usd(folder / "a.usda", short)
    return folder, {suffix: (folder / f"a{suffix}").read_bytes() for suffix in (*SUFFIXES, ".usda")}


def units(suffix):
    return {"unit": 1e-3} if suffix in (".bcc", ".npz") else {}


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=EXAMPLES, deadline=None)
@given(changes=damage)
def test_damaged_bytes(originals, suffix, changes):
    folder, data = originals
    path = folder / f"damaged{suffix}"
    path.write_bytes(damaged(data[suffix], changes))
    check_file(path, **units(suffix))


@pytest.mark.parametrize("suffix", [".csv", ".pyp"])
@settings(max_examples=EXAMPLES, deadline=None)
@given(changes=words)
def test_other_words(originals, suffix, changes):
    folder, data = originals
    path = folder / f"reworded{suffix}"
    path.write_text(reworded(data[suffix].decode(), changes), encoding="utf-8")
    check_file(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=EXAMPLES // 2, deadline=None)
@given(content=st.binary(min_size=1, max_size=300))
def test_bytes_of_chance(originals, suffix, content):
    path = originals[0] / f"chance{suffix}"
    path.write_bytes(content)
    check_file(path, **units(suffix))


@settings(max_examples=EXAMPLES, deadline=None)
@given(changes=words)
def test_stages_of_other_words(originals, changes):
    """In this process, where it is quick: what `read_wires` does in another one."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    try:
        if not layer.ImportFromString(reworded(originals[1][".usda"].decode(), changes)):
            return
        found = curves_of(stage_arrays(Usd.Stage.Open(layer), None), "spline")
    except (Tf.ErrorException, BadFile):
        return
    try:
        check_wires(_wires(found, found.metres, 1e-3))
    except BadFile as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("seed", range(3))
def test_damaged_stages(originals, seed):
    rng = np.random.default_rng(seed)
    folder, _ = originals
    stage = Usd.Stage.Open(str(folder / "a.usda"))
    stage.GetRootLayer().Export(str(folder / "a.usdc"))
    content = bytearray((folder / "a.usdc").read_bytes())
    for place in rng.integers(0, len(content), 6):
        content[place] = int(rng.integers(256))
    path = folder / "damaged.usdc"
    path.write_bytes(content)
    check_file(path)
