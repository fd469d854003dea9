"""Machine-knit swatches as one open wire, as yarn files have them: plain, 1 x 1 rib and a cable, with overlaps as drawn.

`python tools/studies/swatches.py DIR` writes a file and a scene of each.

Row r of stitches is, with t = 2 pi x the number of stitches from its begin,

    x = W t/(2 pi) + BULGE W sin 2t     y = r C - HEIGHT C cos t     z = f Z cos 2t

and rows run there and back. In a rib the sign f changes from stitch to stitch, at the feet. In a cable CROSSED stitches change
places with the next ones: their heads are that much to the side, those that go right in front of those that go left. Z gives the
overlap, which is at least two thirds in a cable.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from study import new_parser

from warpknit.wires.centre_lines import Wires
from warpknit.wires.overlaps import find_overlaps

KINDS = ("plain", "rib", "cable")
DIAMETER, WALE, COURSE = 1e-3, 5e-3, 4e-3  # [m]
BULGE, HEIGHT = 0.22, 0.8
POINTS = 16  # of a stitch
CROSSED, CABLE, EVERY = 2, 6, 4  # stitches that cross the same number of others; width and height of a repeat of the cable
APART, LONGER = 2e-3, 3e-3  # [m] of crossed stitches from the others, at their middle; of their rows than of others
SMALL = (12, 9)  # stitches and rows of the swatch from which the overlap is found


def swatch(kind: str, stitches: int, rows: int, overlap: float) -> np.ndarray:
    """Points (point, 3) [m] of a swatch with overlaps of up to this share of the thickness."""
    return _drawn(kind, stitches, rows, _height(kind, overlap))


@cache
def _height(kind: str, overlap: float) -> float:
    """[m] Z of an overlap, by bisection."""
    low, high = 0.0, DIAMETER
    for _ in range(20):
        middle = 0.5 * (low + high)
        points = _drawn(kind, *SMALL, middle)
        closest = find_overlaps(Wires((points,), ("open",), np.zeros((1, 2), dtype=int), None, None, None), DIAMETER).closest
        low, high = (low, middle) if closest is None or closest > (1.0 - overlap) * DIAMETER else (middle, high)
    return high


def _drawn(kind: str, stitches: int, rows: int, height: float) -> np.ndarray:
    """Points (point, 3) [m] of the rows, joined by half circles."""
    parts, low = [], 0.0
    angle = np.pi * np.array([0.2, 0.4, 0.6, 0.8])[:, None]
    for row in range(rows):
        crosses = kind == "cable" and row % EVERY == EVERY - 1
        extra = LONGER * crosses
        points = _row(kind, stitches, crosses, height, extra) + [0.0, low, 0.0]
        side = 1.0 if row % 2 == 0 else -1.0
        parts.append(points if side > 0.0 else points[::-1])
        low += COURSE + extra
        turn = np.hstack([side * np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle])
        parts.append(parts[-1][-1] + 0.5 * (COURSE + extra) * turn)
    return np.concatenate(parts[:-1])


def _row(kind: str, stitches: int, crosses: bool, height: float, extra: float) -> np.ndarray:
    """Points (point, 3) [m] of a row, from left to right."""
    place = np.arange(stitches * POINTS + 1) / POINTS
    number = np.minimum(place.astype(int), stitches - 1)
    t = 2.0 * np.pi * place
    up = 0.5 * (1.0 - np.cos(t))
    x = WALE * (place + BULGE * np.sin(2.0 * t))
    y = extra * up - HEIGHT * COURSE * np.cos(t)
    z = height * np.cos(2.0 * t)
    if kind == "rib":
        z *= np.where(number % 2 == 0, 1.0, -1.0) * np.minimum(1.0, 2.0 * np.abs(np.sin(0.5 * t)))
    if crosses:
        within = number % CABLE - (CABLE // 2 - CROSSED)
        is_whole = number - number % CABLE + CABLE <= stitches
        goes = np.where((0 <= within) & (within < 2 * CROSSED) & is_whole, np.where(within < CROSSED, 1.0, -1.0), 0.0)
        x, z = x + CROSSED * WALE * goes * up, z + APART * goes * np.sin(np.pi * up)
    return np.stack([x, y, z], axis=1)


SCENE = """\
[wires]
file = "{name}.npz"
unit = "m"
loop_size = "5.5 mm"

[wire]
diameter = "1 mm"
youngs_modulus = "{modulus}"
poissons_ratio = 0.3
density = "1300 kg/m3"
yield_stress = "1 GPa"

[contact]
friction = 0

[load]
strain_warp = 0.02

[output]
frames = 2
"""


def write(directory: Path, name: str, kind: str, size: tuple[int, int], overlap: float, modulus: str) -> None:
    """Write a swatch of these stitches and rows, and its scene."""
    directory.mkdir(parents=True, exist_ok=True)
    np.savez(directory / f"{name}.npz", wire=swatch(kind, *size, overlap))
    (directory / f"{name}.toml").write_text(SCENE.format(name=name, modulus=modulus))


def main() -> None:
    parser = new_parser(__doc__)
    parser.add_argument("directory", metavar="DIR", type=Path, help="where files and scenes go")
    directory = parser.parse_args().directory
    for nodes, size in (("25k", (36, 36)), ("100k", (72, 72))):
        for kind, overlaps in (("plain", (20, 50, 90)), ("rib", (50, 90)), ("cable", (70, 90))):
            for overlap in overlaps:
                write(directory, f"{kind}_{overlap}_{nodes}", kind, size, 0.01 * overlap, "1 MPa")
    write(directory, "plain_50_25k_stiff", "plain", (36, 36), 0.5, "100 GPa")


if __name__ == "__main__":
    main()
