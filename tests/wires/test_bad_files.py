"""Whatever is wrong with a file of wires is one line that names the file, what it is, and what would do."""

import os
import struct
import zipfile

import numpy as np
import pytest
import wire_samples as samples
from pxr import Sdf, Usd

from warpknit.base.errors import SceneError
from warpknit.scene import wire_file as limits
from warpknit.wires import bases, file_curves, read
from warpknit.wires.bases import BadFile
from warpknit.wires.file_curves import curves_of
from warpknit.wires.read import read_wires
from warpknit.wires.stage_process import stage_arrays

UNITS = {".bcc": 1e-3, ".npz": 1e-3}


def refused(path, **options) -> str:
    """The line that a file is refused with."""
    with pytest.raises(SceneError) as caught:
        read_wires(path, **({"node_spacing": 5e-5, "unit": UNITS.get(path.suffix)} | options))
    line = str(caught.value)
    assert line.startswith(f"{path}: wires.") and "; " in line and "\n" not in line
    return line


def valid(folder, suffix):
    """A good file of this format."""
    path = folder / f"knit{suffix}"
    if suffix == ".pyp":
        samples.write_cell(path)
    else:
        write = {".csv": samples.write_csv, ".npz": samples.write_npz, ".bcc": samples.write_bcc}
        write.get(suffix, samples.write_usd)(path, samples.patch())
    return path


NOISE = (bytes(range(256)) * 8, b"\xff\xfe\x00nonsense", b"PK\x03\x04")


@pytest.mark.parametrize("suffix", limits.SUFFIXES)
def test_empty_files(tmp_path, suffix):
    path = tmp_path / f"wires{suffix}"
    path.touch()
    assert "is empty" in refused(path)


@pytest.mark.parametrize(
    ("suffix", "content"),
    [
        *((suffix, noise) for suffix in (".bcc", ".pyp", ".csv", ".npz") for noise in NOISE),
        *zip((".usda", ".usdc", ".usdz"), NOISE, strict=True),
    ],
)
def test_files_that_hold_something_else(tmp_path, suffix, content):
    path = tmp_path / f"wires{suffix}"
    path.write_bytes(content)
    refused(path)


@pytest.mark.parametrize(
    ("suffix", "share"),
    [(".usda", 0.97), (".usdc", 0.97), *((suffix, share) for suffix in (".bcc", ".pyp", ".npz") for share in (0.3, 0.97))],
)
def test_files_that_end_early(tmp_path, suffix, share):
    path = valid(tmp_path, suffix)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    refused(path)


def test_what_is_no_file(tmp_path):
    (tmp_path / "folder.csv").mkdir()
    os.mkfifo(tmp_path / "pipe.csv")
    assert "not a file" in refused(tmp_path / "folder.csv")
    assert "not a file" in refused(tmp_path / "pipe.csv")
    assert "none.csv" in refused(tmp_path / "none.csv")
    (tmp_path / "knit.obj").write_text("v 0 0 0", encoding="utf-8")
    assert " .obj" in refused(tmp_path / "knit.obj")


def test_sizes_are_looked_at_before_files_are_read(tmp_path):
    path = tmp_path / "huge.bcc"
    with path.open("wb") as file:
        file.truncate(limits.MOST_BYTES + 1)  # takes no room on the disk
    assert f"{limits.MOST_BYTES + 1:,} bytes" in refused(path)


def test_counts_are_looked_at_before_memory_is_taken(tmp_path):
    header = struct.pack("<3sB2sBBQQ40s", b"BCC", 0x44, b"C0", 3, 2, 1, 2**62, b"")
    (tmp_path / "many.bcc").write_bytes(header)
    said = refused(tmp_path / "many.bcc")
    assert f"{2**62:,} points" in said and f" {bases.MOST_POINTS:,}" in said
    (tmp_path / "many.pyp").write_text("*pattern\n1 1 0.1 1e8\n", encoding="utf-8")
    assert f" {bases.MOST_POINTS:,}" in refused(tmp_path / "many.pyp")
    with zipfile.ZipFile(tmp_path / "many.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("points.npy", "counts.npy"):
            with archive.open(name, "w") as file:
                shape = "(100000000000, 3)" if name == "points.npy" else "(1,)"
                text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
                file.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + bytes(1 << 20))
    assert f" {file_curves.MOST_NUMBERS:,}" in refused(tmp_path / "many.npz")


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("nan.csv", "x,y,z\n0,0,0\n1,nan,0\n", "wire 1: point 2 at 1, nan, 0"),
        ("inf.csv", "x,y,z\n0,0,0\n1,inf,0\n", "point 2 at 1, inf, 0"),
        ("far.csv", "x,y,z\n0,0,0\n1,1e300,0\n", "point 2 at 1, 1e+300, 0"),
        ("word.csv", "x,y,z\n0,0,zero\n", "'0, 0, zero' in line 2"),
        ("comma.csv", "x;y;z\n0,0;0,0;0,0\n1,5;0,2;0,0\n", "'0,0' in line 2"),
        ("thousand.csv", 'x,y,z\n0,0,0\n"1,500",0,0\n', "'1,500' in line 3"),
        (
            "commas.csv",
            "x,y,z\n0,0,0,0,0,0\n",
            "6 columns in line 2, 3 in the lines before; a comma parts columns: write decimal points",
        ),
        ("radius.csv", "x [mm],y [mm],z [mm],radius [mm]\n0,0,0,1\n", "'x [mm], y [mm], z [mm], radius [mm]'"),
        ("two.csv", "0,0\n1,1\n", "2 columns in line 1"),
        ("more.csv", "0,0,0\n1,1,1,1\n", "4 columns in line 2, 3 in the lines before"),
        ("heads.csv", "x,y,y\n0,0,0\n", "'x, y, y'"),
        ("units.csv", "x [mm],y [m],z [m]\n0,0,0\n1,1,1\n", "'x [mm], y [m], z [m]'"),
        ("unit.csv", "x [kg],y [kg],z [kg]\n0,0,0\n1,1,1\n", "[kg]"),
        ("none.csv", "x [mm],y [mm],z [mm]\n", "a file without wires"),
        ("point.csv", "0,0,0\n", "wire 1: "),
        ("same.csv", "0,0,0\n0,0,0\n0,0,0\n", "wire 1: "),
        ("head.pyp", "1 1 0.1 1\n", "'1 1 0.1 1'"),
        ("short.pyp", "*pattern\n1 1 0.1 2\n\n*Q\n0 0 0 0\n", "1 lines under *Q where 2"),
        ("edges.pyp", "*pattern\n1 1 0.1 1\n*Q\n0 0 0 0\n*E\n0 1 1 0\n", "*E"),
        ("far.pyp", "*pattern\n1 1 0.1 1\n*Q\n0 0 0 0\n*E\n0 0 1e9 0\n", "*E"),
        ("rest.pyp", "*pattern\n1 1 0.1 1\n*Q\n0 0 0 0\n*E\n0 0 1 0\n*RL\n-1\n", "*RL"),
        ("flat.pyp", "*pattern\n0 1 0.1 1\n", "*pattern 0 1 0.1 1"),
    ],
)
def test_texts(tmp_path, name, text, reason):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    assert reason in refused(path, unit=1.0 if "[" not in text else None)


@pytest.mark.parametrize(
    ("place", "value", "reason"),
    [
        (0, b"BCD", "BCC"),
        (3, b"\x88", "sizes 0x88"),
        (4, b"C1", "curves 'C1'"),
        (6, b"\x02", "2 dimensions"),
        (7, b"\x03", "up 3"),
        (8, struct.pack("<Q", 4), " 4 curves"),
        (64, struct.pack("<i", 0), "curve 1 "),
        (64, struct.pack("<i", 10_000), "curve 1 with 10000 control points"),
        (68, struct.pack("<f", np.nan), "curve 1: point 1 at nan"),
    ],
)
def test_headers_and_counts_of_bcc(tmp_path, place, value, reason):
    path = valid(tmp_path, ".bcc")
    data = bytearray(path.read_bytes())
    data[place : place + len(value)] = value
    path.write_bytes(data)
    assert reason in refused(path)


@pytest.mark.parametrize(
    ("arrays", "reason"),
    [
        ({"points": np.zeros((4, 2)), "counts": np.array([4])}, "points (4, 2)"),
        ({"points": np.eye(3), "counts": np.array([1, 1])}, " 3 points"),
        ({"points": np.eye(3), "counts": np.array([-1, 4])}, " 3 points"),
        ({"points": np.eye(3), "counts": np.array([3]), "closed": np.array([7])}, "closed (1,)"),
        ({"a": np.eye(4)}, "a of shape (4, 4)"),
        ({"a": np.array([[1j, 0, 0]])}, "complex128"),
        ({"a": np.array([None])}, "a.npy of type object"),
        ({}, "a file without wires"),
    ],
)
def test_arrays(tmp_path, arrays, reason):
    np.savez(tmp_path / "bad.npz", **arrays)
    assert reason in refused(tmp_path / "bad.npz")


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ('def Xform "World" {}', "BasisCurves"),
        ('def NurbsCurves "A" {}', "BasisCurves"),
        ("[3]; points = [(0,0,0)]", "/A with 1 "),
        ("[-1]; points = []", "/A with 0 "),
        ("[2000000000, 2000000000]; points = []", "4,000,000,000 points"),
        ("[4]; points = [(0,0,0), (nan,0,0), (1,0,0), (2,0,0)]", "point 2 at nan"),
        ("[5]; points = [(0,0,0), (1,0,0), (2,0,0), (3,0,0), (4,0,0)]", "curve 1 of /A: "),
        ('[4]; points = [(0,0,0), (1,0,0), (2,0,0), (3,0,0)]; basis = "power"', "curve 1 of /A: basis 'power'"),
    ],
)
def test_stages(body, reason):
    """In this process, where it is quick."""
    if body.startswith("["):
        body = body.replace("points", "point3f[] points").replace("basis", "uniform token basis").replace("; ", "\n")
        body = f'def BasisCurves "A" {{\nint[] curveVertexCounts = {body}\n}}'
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(f"#usda 1.0\n(metersPerUnit = 0.001)\n{body}\n")
    with pytest.raises(BadFile) as caught:
        curves_of(stage_arrays(Usd.Stage.Open(layer), None), "spline")
    assert reason in str(caught.value)


def test_a_stage_that_the_library_never_finishes(tmp_path, monkeypatch):
    monkeypatch.setattr(file_curves, "STAGE_PATIENCE", 0.01)
    assert " 0.01 s" in refused(valid(tmp_path, ".usda"), unit=None)


def test_keys_that_a_file_does_not_go_with(tmp_path):
    for suffix in (".bcc", ".npz"):
        assert "wires.unit: missing" in refused(valid(tmp_path, suffix), unit=None)
    assert "wires.unit: 1 mm " in refused(valid(tmp_path, ".csv"), unit=1e-3)
    assert "wires.unit: with 1000 km " in refused(valid(tmp_path, ".bcc"), unit=1e6)
    assert "wires.node_spacing: 1 pm " in refused(valid(tmp_path, ".bcc"), node_spacing=1e-12)
    assert "wires.period: " in refused(valid(tmp_path, ".bcc"), period=(1e-3, 1e-3))
    assert "wires.period: " in refused(valid(tmp_path, ".pyp"), period=(1e-3, 1e-3))
    assert "1e-09 x 1e-09" in refused(valid(tmp_path, ".bcc"), period=(1e-12, 1e-12))
    assert read.MOST_NODES > bases.MOST_POINTS
