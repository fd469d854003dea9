"""Chain notation to clasps: the geometry of one repeat of endless warp-knitted cloth.  NumPy and SciPy only.

chain -> lapping -> loops -> centreline -> crossings -> clasps -> openings -> cloth
"""

from .centreline import Thread
from .chain import KnitError
from .clasps import Arm, Clasp
from .cloth import Cloth, knit_cloth
from .crossings import Crossings
from .lapping import Stitch
from .loops import LoopProportions
from .openings import Opening, Rhombus

__all__ = [
    "Arm",
    "Clasp",
    "Cloth",
    "Crossings",
    "KnitError",
    "LoopProportions",
    "Opening",
    "Rhombus",
    "Stitch",
    "Thread",
    "knit_cloth",
]
