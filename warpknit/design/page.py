"""report.html: a self-contained HTML page with embedded pictures."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

STYLE = """
body { font: 11pt/1.45 Georgia, 'Times New Roman', serif; max-width: 50em; margin: 2em auto; padding: 0 1em; color: #202020; }
p { overflow-wrap: anywhere; }
h1 { font-size: 1.6em; margin-bottom: 0.2em; } h2 { font-size: 1.2em; margin-top: 1.8em; border-bottom: 1px solid #C0C0C0; }
table { border-collapse: collapse; margin: 0.8em 0; }
td, th { padding: 0.2em 0.9em 0.2em 0; text-align: left; vertical-align: top; }
th { font-weight: normal; color: #505050; } thead th { border-bottom: 1px solid #909090; }
tbody th { white-space: nowrap; }
figure { margin: 1em 0; } img { max-width: 100%; max-height: 100vh; } figcaption { color: #505050; font-size: 0.92em; }
.warning { border-left: 4px solid #D55E00; padding-left: 0.8em; }
@media (max-width: 40em) {
  body { margin: 0.5em auto; } table { display: block; overflow-x: auto; } td, th { padding-right: 0.5em; }
  tbody th { white-space: normal; }
}
@media print {
  @page { size: A4; margin: 18mm; }
  body { margin: 0; padding: 0; max-width: none; font-size: 10pt; }
  h2 { break-after: avoid; } h2.new-page { break-before: page; } figure, tr, .warning { break-inside: avoid; }
  thead { display: table-header-group; } figure img { max-height: 215mm; }
}
"""


class Page:
    """An HTML page under construction; text is escaped, pictures are embedded."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._parts = [f"<h1>{html.escape(title)}</h1>"]

    def heading(self, text: str, *, new_page: bool = False) -> None:
        """A heading; `new_page`: on a new page of paper."""
        mark = ' class="new-page"' if new_page else ""
        self._parts.append(f"<h2{mark}>{html.escape(text)}</h2>")

    def text(self, text: str) -> None:
        self._parts.append(f"<p>{html.escape(text)}</p>")

    def warning(self, text: str) -> None:
        self._parts.append(f'<p class="warning">{html.escape(text)}</p>')

    def table(self, rows: Iterable[Sequence[str]], headings: Sequence[str] = ()) -> None:
        """A table; the first cell of each row is its name."""
        lines = [_row(row, 1) for row in rows]
        head = f"<thead>{_row(headings, len(headings))}</thead>" if headings else ""
        self._parts.append(f"<table>{head}<tbody>{''.join(lines)}</tbody></table>")

    def figure(self, path: Path, caption: str) -> None:
        """Embed a PNG file."""
        data = base64.b64encode(path.read_bytes()).decode("ascii")
        words = html.escape(caption)
        image = f'<img alt="{words}" src="data:image/png;base64,{data}">'
        self._parts.append(f"<figure>{image}<figcaption>{words}</figcaption></figure>")

    def html(self) -> str:
        """The whole page."""
        body = "\n".join(self._parts)
        head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        head += f"<title>{html.escape(self._title)}</title><style>{STYLE}</style>"
        return f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n'


def _row(cells: Sequence[str], headings: int) -> str:
    kinds = ["th"] * headings + ["td"] * (len(cells) - headings)
    return "<tr>" + "".join(f"<{kind}>{html.escape(cell)}</{kind}>" for kind, cell in zip(kinds, cells, strict=True)) + "</tr>"
