"""Layers on the disk: whole or absent, and errors of USD as errors of the system."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf, Usd, UsdGeom

from warpknit.base.files import path_aside
from warpknit.export.usd.tiles import MILLIMETRES

__all__ = ["save_layer", "set_units", "write_layer"]


def save_layer(layer: Sdf.Layer, path: Path) -> None:
    """Save a layer that was made for a file. Raises OSError, naming `path`, where the disk fails."""
    with _disk_errors(path):
        _written(layer.Save(), path)


def write_layer(layer: Sdf.Layer, path: Path) -> None:
    """Write a layer that stays in memory. Raises OSError where the disk fails."""
    with path_aside(path) as aside, _disk_errors(path):
        _written(layer.Export(str(aside)), path)


def set_units(stage: Usd.Stage) -> None:
    UsdGeom.SetStageMetersPerUnit(stage, 1.0 / MILLIMETRES)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)


@contextmanager
def _disk_errors(path: Path) -> Iterator[None]:
    """USD tells of a full disk in its own way: as `OSError` with the path."""
    try:
        yield
    except Tf.ErrorException as error:
        number = errno.ENOSPC if os.strerror(errno.ENOSPC) in str(error) else errno.EIO
        raise OSError(number, os.strerror(number), str(path)) from error


def _written(done: bool, path: Path) -> None:
    if not done:
        raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
