"""[wires] of a scene: a file of centre lines in place of a knit. `warpknit.wires` reads it."""

from __future__ import annotations

import stat
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Annotated, Any

from ..base.errors import BadValue
from ..base.text import either
from . import values
from .keys import Table, key
from .values import Choice, Pair, Quantity, Unit

USD = (".usd", ".usda", ".usdc", ".usdz")
POLYLINES = (".csv", ".npz")
SUFFIXES = (*USD, ".bcc", ".pyp", *POLYLINES)
WITHOUT_UNIT = (".bcc", ".npz")
WITH_WIDTHS = (*USD, ".pyp")
MOST_THICKNESS = 0.01  # [m]
LOOP_SIZE = 20.0  # diameters of the wire, where the scene does not say
LOOP_LENGTH = 3.3  # of wire in a loop, over its size, as in the double atlas net
MOST_BYTES = 256 << 20  # of a file


class WireFileError(BadValue):
    """An unusable file of wires, or another key of [wires]."""

    def __init__(self, wrong: str, instead: str, key: str = "file") -> None:
        super().__init__(key, wrong, instead)


@dataclass(frozen=True, repr=False)
class WireArrays:
    """Centre lines in memory, as the bytes of an .npz file."""

    data: bytes
    name = "wires.npz"  # of the copy that a run keeps beside its scene.toml
    suffix = ".npz"

    def __repr__(self) -> str:
        return f"<{self.name} in memory>"


class FileOrArrays(values.Text):
    """The name of a file, or `WireArrays`."""

    def __call__(self, value: Any) -> Any:
        return value if isinstance(value, WireArrays) else super().__call__(value)


@dataclass(frozen=True, kw_only=True)
class WiresTable(Table):
    """[wires], in place of [knit]: a file of centre lines and how it is read."""

    file: Annotated[str | WireArrays, FileOrArrays(values.FILE_NAME.pattern, values.FILE_NAME.allowed)] = key(
        "File name relative to the scene: `.usd`, `.usda`, `.usdc`, `.usdz`, `.bcc`, `.pyp`, `.csv` or `.npz`. At most 256"
        " MiB and two million points. In Python also arrays: `warpknit.wires_from_arrays`.",
        compare=False,  # where it is: what is in it is compared
    )
    unit: Annotated[float, Unit("length", above=0.0, usual="mm")] | None = key(
        "Length unit of the file: required with `.bcc`, `.npz` and a `.csv` without units, not allowed with USD. A `.pyp` is in"
        " m.",
        None,
        left_out="the file's",
    )
    node_spacing: values.Length = key(
        "Distance between nodes, evenly spaced in arc length along each wire; at most four million nodes. A run requires at least"
        " half a diameter.",
        None,
        left_out="the wire's diameter",
    )
    loop_size: values.LoopLength = key(
        "Characteristic length W, the counterpart of the wale spacing of a knit. It scales forces (EI/W^2) and energies (EI/W per"
        " loop). Lenses of hooked wires are searched up to 1.65 W; wires that cross up to W/2 apart count as one layer.",
        None,
        left_out="20 diameters of the wire",
    )
    interpolation: Annotated[str, Choice(("spline", "linear"))] = key(
        "Interpolation between the points of polylines: a smooth curve, or straight lines with corners. Polylines are `.csv`,"
        " `.npz`, `.pyp`, linear USD curves, and `PL` of a `.bcc`.",
        "spline",
    )
    closed: values.Flag = key(
        "Join the ends of all wires of a `.csv` or `.npz`. A wire whose last point repeats its first is always closed.", False
    )
    period: Annotated[tuple[float, float], Pair(Quantity("length", above=0.0, usual="3.4 mm"))] | None = key(
        "Period of a periodic mesh along weft and warp. Open wires continue in the next period; their ends must be whole"
        " periods apart. A `.pyp` contains the period.",
        None,
        left_out="the file's",
    )
    repeats: values.WireRepeats = key("Repeats of the file along weft and warp in one tile.", (1, 1))
    widths: values.Flag | None = key(
        "The file sets the thickness of each wire, plating and ends included: `widths` of USD, radius of a `.pyp`. This"
        " sets contact, stiffness and mass of each wire. `wire.diameter` is the thickest wire.",
        None,
        left_out="true if the file has widths and `wire.diameter` is left out",
    )
    overlaps: Annotated[str, Choice(("prestress", "at rest"))] = key(
        "Treatment of wires that overlap as drawn. `prestress`: the shape as drawn is free of stress, and a run pushes the wires"
        " apart against their stiffness. `at rest`: the wires are first moved apart, the deepest overlaps first; this shape is"
        " free of stress.",
        "prestress",
    )
    time: Annotated[float, Quantity("number")] | None = key(
        "Time code of an animated USD stage, such as the `scene.usda` of a run.", None, left_out="the first"
    )

    @property
    def file_name(self) -> str:
        """The name of the file, without its folder."""
        return self.file.name if isinstance(self.file, WireArrays) else PurePath(self.file).name


@dataclass(frozen=True, kw_only=True)
class WireFile(WiresTable):
    """An existing file of centre lines."""

    digest: str  # SHA-256 of what is in it, in hex

    @property
    def loop_length(self) -> float:
        """[m] approximate length of wire in a loop."""
        return LOOP_LENGTH * self.loop_size

    @property
    def nodes_per_loop(self) -> int:
        return max(8, round(self.loop_length / self.node_spacing))

    @property
    def path(self) -> Path | WireArrays:
        return self.file if isinstance(self.file, WireArrays) else Path(self.file)


def checked_bytes(path: Path | WireArrays) -> bytes:
    """Contents of a file of wires, after a check of its size. Raises `WireFileError`."""
    if isinstance(path, WireArrays):
        return path.data
    instead = f"name a file of wires: {either(SUFFIXES)}"
    if path.suffix.lower() not in SUFFIXES:
        raise WireFileError(f"ends in {path.suffix}" if path.suffix else "has no suffix", instead)
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise WireFileError("is not a file", instead)
        if not 0 < found.st_size <= MOST_BYTES:
            size = f"has {found.st_size:,} bytes, more than {MOST_BYTES:,}"
            raise WireFileError("is empty" if found.st_size == 0 else size, instead)
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is unreadable"
        raise WireFileError(f"cannot be read ({reason.lower()})", instead) from error
