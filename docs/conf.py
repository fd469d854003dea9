"""The documents as a site: `sphinx-build -W docs docs/_build`."""

from __future__ import annotations

import inspect
import itertools
import os
import re
import sys
from html import escape
from pathlib import Path

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger
from sphinx.writers.html5 import HTML5Translator

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))

import warpknit  # noqa: E402

logger = getLogger(__name__)
project = "warpknit"
author = "the warpknit developers"
copyright = author
version = release = warpknit.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx_click", "sphinx_copybutton"]
exclude_patterns = ["_build", "changelog.d", "static"]
html_math_renderer = "mathml"
nb_execution_mode = "off"  # notebooks are kept with their outputs: python tools/notebooks.py
nb_mime_priority_overrides = [("html", "text/html", 0)]
html_theme = "furo"
html_title = f"warpknit {version}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_copyright = html_show_sphinx = html_copy_source = False
copybutton_exclude = ".linenos, .gp, .go"

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
suppress_warnings = ["myst.header"]  # pages that are parts of another begin at its second level
default_role = "literal"
smartquotes = False  # it makes one dash of the two of an option
autodoc_typehints = "none"
autodoc_member_order = "bysource"

# pages outside of docs/ that the site includes, and where
INCLUDED = {
    ROOT / "CHANGELOG.md": "changelog",
    ROOT / "CONTRIBUTING.md": "contributing",
}
LINK = re.compile(r"(!?)\[([^]]*)\]\(([^)#\s:]+)(#[^)\s]*)?\)")


def links_of_the_site(text: str, folder: Path, page: Path) -> str:
    """Links between documents, as in the repository, become links between pages; those to other files become the names.

    folder: of the document. page: of the page that has its text.
    """

    def link(found: re.Match[str]) -> str:
        picture, words, target, anchor = found[1], found[2], (folder / found[3]).resolve(), found[4] or ""
        if target in INCLUDED:
            target = DOCS / f"{INCLUDED[target]}.md"
        elif not target.exists():
            return found[0]  # Sphinx warns
        elif DOCS not in target.parents:
            return words if words.startswith("`") else f"`{target.relative_to(ROOT).as_posix()}`"
        return f"{picture}[{words}]({os.path.relpath(target, page).replace(os.sep, '/')}{anchor})"

    return LINK.sub(link, text)


def read_source(app: Sphinx, name: str, content: list[str]) -> None:
    page = Path(app.env.doc2path(name))
    if page.suffix != ".md":
        return
    source, text = page, content[0]
    for path, included in INCLUDED.items():
        if included == name:
            source, text = path, path.read_text(encoding="utf-8")
            app.env.note_dependency(str(path))
    content[0] = links_of_the_site(text, source.parent, page.parent)


def docstring(app: Sphinx, kind: str, name: str, item: object, options: object, lines: list[str]) -> None:
    """Docstrings as they stand: indented paragraphs are examples, parameters become a list, tables keep their lines."""
    if not any(lines) and isinstance(item, property):  # of a protocol: the comment behind its signature
        lines[:] = re.findall(r": \.\.\.  # (.*)", inspect.getsource(item.fget))
    paragraphs = re.split(r"\n\s*\n", "\n".join(lines).strip("\n"))
    names = parameters(item)
    out: list[str] = []
    for paragraph in paragraphs:
        rows = paragraph.split("\n")
        if all(row.startswith("    ") for row in rows):
            out += [".. code-block:: python", "", *rows, ""]
        elif rows[0].startswith(">>> "):
            out += [*rows, ""]
        elif rows[0].startswith("|"):
            out += [*("| " + row.strip().replace("|", "\\|") for row in rows), ""]
        elif rows[0].partition(": ")[0].split(", ")[0] in names:
            out += parameter_list(rows, names)
        else:
            out += with_blocks(rows)
    lines[:] = out


def parameters(item: object) -> set[str]:
    """Names of the parameters of a function or a class."""
    try:
        return set(inspect.signature(item).parameters) if callable(item) else set()
    except ValueError:
        return set()


def parameter_list(rows: list[str], names: set[str]) -> list[str]:
    """Rows `name: meaning` as a list; a row may have several of them, and go on in the next one."""
    known = "|".join(sorted(names))
    text = re.sub(rf"\. ((?:{known})(?:, (?:{known}))*): ", r".\n\1: ", "\n".join(rows))
    out: list[str] = []
    for row in text.split("\n"):
        if found := re.match(rf"((?:{known})(?:, (?:{known}))*): (.*)", row):
            out.append(f"* **{found[1]}**: {escaped(found[2])}")
        elif re.fullmatch(r"    \w+\(.*\)", row):
            out.append(f"  ``{row.strip()}``")
        elif row.startswith(" ") and out:
            out.append(f"  {escaped(row.strip())}")
        else:
            out += ["", escaped(row)] if out and out[-1].startswith(("* ", "  ")) else [escaped(row)]
    return [*out, ""]


def with_blocks(rows: list[str]) -> list[str]:
    """A paragraph, whose indented rows keep their columns."""
    out: list[str] = []
    for indented, part in itertools.groupby(rows, lambda row: row.startswith("    ")):
        texts = list(part)
        out += ["", ".. code-block:: text", "", *texts, ""] if indented else map(escaped, texts)
    return [*out, ""]


def escaped(text: str) -> str:
    return text.replace("*", "\\*").replace("|", "\\|")


def mathml(translator: HTML5Translator, node: nodes.math | nodes.math_block) -> None:
    """Formulas as MathML, which browsers draw by themselves: the site needs no scripts from elsewhere."""
    display = isinstance(node, nodes.math_block)
    try:
        text = tex2mathml(node.astext(), as_block=display)
    except MathError as error:
        logger.warning("%s: %s", error, node.astext(), location=node)
        text = escape(node.astext())
    translator.body.append(f'<div class="math">{text}</div>' if display else text)
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", inline_renderers=(mathml, None), block_renderers=(mathml, None))
    app.connect("source-read", read_source)
    app.connect("autodoc-process-docstring", docstring)
    return {"parallel_read_safe": True}
