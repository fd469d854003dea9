"""Documents generated from the table of measures."""

from __future__ import annotations

from .table import MEASURES


def measure_table() -> str:
    """Every measure and the files that have it, as a table in Markdown."""
    found: dict[str, list[str]] = {}
    for line in MEASURES:
        cells = found.setdefault(line.name, ["", "", ""])
        here = ("x" if line.history else "", line.summary, {"map": "map.csv", "details": "map_details.csv"}.get(line.map, ""))
        cells[:] = [old or new for old, new in zip(cells, here, strict=True)]
    rows = [(name, *cells) for name, cells in found.items() if any(cells)]
    head = ["| name | history.csv | section of summary.json | map |", "|---|---|---|---|"]
    return "\n".join(
        [*head, *(f"| `{name}` | {history} | {summary and f'`{summary}`'} | {table} |" for name, history, summary, table in rows)]
    )
