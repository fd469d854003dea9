"""Files that are either whole or absent.

A file is written under a hidden name beside its place, brought to the disk, and renamed. Whoever is killed on the way
leaves the earlier file, or none, and a hidden leftover that the next attempt overwrites.
"""

import csv
import errno
import os
import time
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np


@contextmanager
def path_aside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a hidden path with the same suffix; rename it at the end. For libraries that open files themselves.

    If the block raises, `path` is left as it was; an OSError about the hidden path names `path`.
    """
    target = Path(path)
    aside = target.with_name(f".{target.stem}.partial{target.suffix}")
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        aside.unlink(missing_ok=True)
        yield aside
        _flush(aside)
        os.replace(aside, target)
    except BaseException as error:
        with suppress(OSError):  # of a disk that takes no changes
            aside.unlink(missing_ok=True)
        if isinstance(error, OSError) and str(error.filename) == str(aside):
            error.filename = str(path)
        raise
    _flush(target.parent)


@contextmanager
def held_directory(path: str | os.PathLike[str], patience: float) -> Iterator[int | None]:
    """Keep other runs out of a directory. Yields a descriptor: a process that inherits it holds the directory as well.

    Waits `patience` [s] for whoever holds it. Yields None where the system or its disk cannot lock. Raises
    BlockingIOError where it is still held.
    """
    try:
        import fcntl
    except ImportError:  # not a POSIX system
        yield None
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        end = time.monotonic() + patience
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as error:
                if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                    break  # a disk that knows no locks
                if time.monotonic() > end:
                    raise BlockingIOError(error.errno, "held by another process", str(path)) from error
            time.sleep(0.05)
        yield descriptor
    finally:
        os.close(descriptor)


@contextmanager
def write_aside(path: str | os.PathLike[str], mode: Literal["w", "wb"] = "w") -> Iterator[IO[Any]]:
    """Open `path` for writing text in UTF-8 (mode "w") or bytes ("wb"); it takes its place when the block ends well."""
    encoding, newline = ("utf-8", "") if mode == "w" else (None, None)
    with path_aside(path) as aside:
        try:
            file = open(aside, mode, encoding=encoding, newline=newline)  # noqa: SIM115  it is closed before it is renamed
        except OSError as error:  # a place that takes no files, such as /proc, has no such file: the path cannot be used
            number = errno.EACCES if error.errno == errno.ENOENT else error.errno
            raise OSError(number, error.strerror, str(path)) from error
        with file:
            yield file


def write_arrays(path: str | os.PathLike[str], arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays to an npz file, one after the other. `numpy.savez` leaves its archive open where the disk is full."""
    with write_aside(path, "wb") as file, zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def _flush(path: Path) -> None:
    """Bring a file, or the names in a folder, to the disk."""
    if path.is_dir() and os.name == "nt":
        return
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_table(path: str | os.PathLike[str], table: Mapping[str, np.ndarray]) -> Path:
    """Write a CSV file of columns with their headings."""
    with write_aside(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*(np.asarray(column).tolist() for column in table.values()), strict=True))
    return Path(path)
