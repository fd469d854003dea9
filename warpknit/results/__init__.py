"""A finished directory as arrays: `load_run(out)`."""

from .run import Run, load_run
from .table import Table

__all__ = ["Run", "Table", "load_run"]
