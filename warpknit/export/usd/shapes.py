"""The prims that are drawn: wires, contacts, the sheet. What each holds once, and what moves with the frames.

Colours are indices into a table that is written once: an index takes a byte in the file, a colour twelve.
"""

from collections.abc import Container, Mapping
from typing import Any, TypeAlias

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

COLOURS = 256  # entries of the table
GOLD = Gf.Vec3f(1.0, 0.77, 0.34)
OPEN_COLOUR, ACTIVE_COLOUR = Gf.Vec3f(0.75, 0.75, 0.75), Gf.Vec3f(0.8, 0.02, 0.02)
ELSEWHERE_COLOUR = Gf.Vec3f(0.0, 0.17, 0.45)
# Gold at rest to dark violet at the limit: lightness falls steadily, so it reads without colour vision. Linear RGB.
STRESS_COLOURS = np.array([GOLD, (0.90, 0.33, 0.10), (0.60, 0.08, 0.10), (0.22, 0.02, 0.16), (0.03, 0.005, 0.10)])

POINT3, EXTENT, FLOATS, INTS = (
    Sdf.ValueTypeNames.Point3fArray,
    Sdf.ValueTypeNames.Float3Array,
    Sdf.ValueTypeNames.FloatArray,
    Sdf.ValueTypeNames.IntArray,
)
COLOUR_INDEX = "primvars:displayColor:indices"
Values: TypeAlias = dict[str, np.ndarray]
MOVING: Mapping[str, tuple[Any, str]] = {  # type of an attribute, and interpolation of a primvar: on the sheet uniform
    "points": (POINT3, ""),
    "widths": (FLOATS, "vertex"),
    "extent": (EXTENT, ""),
    "primvars:warpknit:stress": (FLOATS, "vertex"),
    "primvars:warpknit:activeShare": (FLOATS, "vertex"),
    "primvars:warpknit:active": (INTS, "vertex"),
    "primvars:warpknit:activePairs": (INTS, "vertex"),
    "primvars:warpknit:normalForce": (FLOATS, "vertex"),
    "primvars:warpknit:normalForceA": (FLOATS, "vertex"),
    "primvars:warpknit:normalForceB": (FLOATS, "vertex"),
    "primvars:warpknit:wireA": (INTS, "vertex"),
    "primvars:warpknit:wireB": (INTS, "vertex"),
    COLOUR_INDEX: (INTS, ""),
}


# --- what moves: attribute -> value -----------------------------------------------------------------------------------


def wire_values(points: np.ndarray, stress: np.ndarray, width: float, stress_max: float | None) -> Values:
    """`points` [point, 3] [mm] from the origin of a tile or the sheet, and `stress` [point or face] [Pa], both float32."""
    values = {"points": points, "extent": _extent(points, width), "primvars:warpknit:stress": stress}
    return values if stress_max is None else values | {COLOUR_INDEX: _colour_index(stress, stress_max)}


def contact_values(points: np.ndarray, force: np.ndarray, active: np.ndarray, width: float) -> Values:
    """`points` [body, 3] [mm] from the tile's origin, `force` [body, 2] [N] and `active` [body, 2] of its two pairs."""
    pairs = active.sum(axis=1)
    return {
        "points": points,
        "extent": _extent(points, width),
        "primvars:warpknit:active": pairs == 2,
        "primvars:warpknit:activePairs": pairs,
        "primvars:warpknit:normalForce": force.min(axis=1),
        "primvars:warpknit:normalForceA": force[:, 0],
        "primvars:warpknit:normalForceB": force[:, 1],
        COLOUR_INDEX: pairs == 2,
    }


def elsewhere_values(points: np.ndarray, force: np.ndarray, wires: np.ndarray, width: float) -> Values:
    """`points` [contact, 3] [mm] from the tile's origin, `force` [contact] [N] and `wires` [contact, 2] of a record.

    In place of none a point of no width and no wires, -1: Cycles of Blender 5.0 ends at points that are empty.
    """
    if not len(points):
        points, force, wires, width = np.zeros((1, 3), dtype=np.float32), np.zeros(1), np.full((1, 2), -1), 0.0
    return {
        "points": points,
        "widths": np.full(len(points), width),
        "extent": _extent(points, width),
        "primvars:warpknit:normalForce": force,
        "primvars:warpknit:wireA": wires[:, 0],
        "primvars:warpknit:wireB": wires[:, 1],
    }


def _stress_table() -> np.ndarray:
    """Linear RGB (colour, 3), from gold at no stress to dark violet at the largest."""
    last = len(STRESS_COLOURS) - 1
    place = np.linspace(0.0, last, COLOURS)
    channels = [np.interp(place, np.arange(last + 1), channel) for channel in STRESS_COLOURS.T]
    return np.ascontiguousarray(np.stack(channels, axis=1).astype(np.float32))


def _colour_index(stress: np.ndarray, stress_max: float) -> np.ndarray:
    return np.minimum(np.abs(stress) * ((COLOURS - 1) / stress_max) + 0.5, COLOURS - 1).astype(np.int32)


def _extent(points: np.ndarray, width: float) -> np.ndarray:
    """Bounds of points [mm] that are drawn `width` [mm] wide."""
    pad, columns = np.float32(0.5 * width), np.ascontiguousarray(points.T)  # minima along rows are many times faster
    return np.stack([columns.min(axis=1) - pad, columns.max(axis=1) + pad])


def declare(layer: Sdf.Layer, prim: Sdf.Path, names: Container[str]) -> None:
    """Make specs, without values, of the moving attributes that are among `names`."""
    spec = Sdf.CreatePrimInLayer(layer, prim)
    for name, (kind, interpolation) in MOVING.items():
        if name in names and name not in spec.attributes:
            attribute = Sdf.AttributeSpec(spec, name, kind)
            if interpolation:
                attribute.SetInfo("interpolation", "uniform" if prim.name == "Surface" else interpolation)


def author(layer: Sdf.Layer, prim: Sdf.Path, values: Values, time: int | None = None) -> None:
    """Write moving values of a prim at a time code; without one as its pose."""
    declare(layer, prim, values)
    for name, value in values.items():
        kind, path = MOVING[name][0], prim.AppendProperty(name)
        number = np.int32 if kind == INTS else np.float32
        array = kind.type.pythonClass.FromNumpy(np.ascontiguousarray(value, dtype=number))
        if time is None:
            layer.GetAttributeAtPath(path).default = array
        else:
            layer.SetTimeSample(path, time, array)


# --- what is written once ---------------------------------------------------------------------------------------------


def define_wires(
    stage: Usd.Stage, path: Sdf.Path, wires: np.ndarray, counts: np.ndarray, width: np.ndarray, *, shows_stress: bool
) -> UsdGeom.Gprim:
    """width [wire] [mm]"""
    curves = UsdGeom.BasisCurves.Define(stage, path)
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
    curves.CreateCurveVertexCountsAttr(_ints(counts))
    _set_width(curves, float(width.max()))
    if np.ptp(width) > 0.0:
        curves.GetWidthsAttr().Set(Vt.FloatArray.FromNumpy(width.astype(np.float32)))
        curves.SetWidthsInterpolation(UsdGeom.Tokens.uniform)
    _set_primvar(curves, "warpknit:wireId", UsdGeom.Tokens.uniform, _ints(wires))
    _set_stress_colours(curves, UsdGeom.Tokens.vertex if shows_stress else None)
    return curves


def define_contacts(stage: Usd.Stage, path: Sdf.Path, bodies: np.ndarray, body_wires: np.ndarray, width: float) -> UsdGeom.Gprim:
    contacts = UsdGeom.Points.Define(stage, path)
    contacts.CreateIdsAttr(Vt.Int64Array.FromNumpy(np.ascontiguousarray(bodies, dtype=np.int64)))
    _set_width(contacts, width)
    for name, column in (("wireA", 0), ("wireB", 1)):
        _set_primvar(contacts, f"warpknit:{name}", UsdGeom.Tokens.vertex, _ints(body_wires[:, column]))
    contacts.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set([OPEN_COLOUR, ACTIVE_COLOUR])
    return contacts


def define_elsewhere(stage: Usd.Stage, path: Sdf.Path) -> UsdGeom.Gprim:
    contacts = UsdGeom.Points.Define(stage, path)
    contacts.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([ELSEWHERE_COLOUR])
    return contacts


def define_surface(
    stage: Usd.Stage, path: Sdf.Path, face_vertices: np.ndarray, pair_counts: np.ndarray, *, shows_stress: bool
) -> UsdGeom.Gprim:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateFaceVertexCountsAttr(_ints(np.full(face_vertices.shape[0], 4)))
    mesh.CreateFaceVertexIndicesAttr(_ints(face_vertices.ravel()))
    _set_primvar(mesh, "warpknit:pairs", UsdGeom.Tokens.uniform, _ints(pair_counts))
    _set_stress_colours(mesh, UsdGeom.Tokens.uniform if shows_stress else None)
    return mesh


def _set_stress_colours(shape: UsdGeom.Gprim, interpolation: str | None) -> None:
    """The table of stress colours, or gold."""
    primvar = shape.CreateDisplayColorPrimvar(interpolation or UsdGeom.Tokens.constant)
    primvar.Set(Vt.Vec3fArray.FromNumpy(_stress_table()) if interpolation else [GOLD])


def _set_width(shape: Any, width: float) -> None:
    shape.CreateWidthsAttr([width])
    shape.SetWidthsInterpolation(UsdGeom.Tokens.constant)


def _set_primvar(shape: UsdGeom.Gprim, name: str, interpolation: str, values: Vt.IntArray) -> None:
    UsdGeom.PrimvarsAPI(shape).CreatePrimvar(name, INTS, interpolation).Set(values)


def _ints(values: np.ndarray) -> Vt.IntArray:
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, dtype=np.int32))
