"""The gallery of the documents: every scene with its picture and time; writes docs/gallery.md and docs/images/gallery.

python tools/gallery.py [SCENE ...]        some scenes only, long ones too: the others keep picture and time
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
PAGE, PICTURES = ROOT / "docs" / "gallery.md", ROOT / "docs" / "images" / "gallery"
LIMIT, LONG = 60.0, 1800.0  # [s] planned or run, of scenes that are not named and of those that are
WIDTH, HEIGHT = 560, 320  # [pixels] at least
FIGURES = ("reflection_tension", "contact_map", "hook", "mesh", "panel")  # the first one that a run has; of a facet, the panel

COMMAND = "#     "  # before a command in the comment of a scene

HEAD = """# Gallery

Each scene has a picture and its wall time on two shared cores of a Xeon, without compilation (`python tools/gallery.py`).

"""


def main(chosen: list[str]) -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    old = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    entries = []
    names = [Path(name).stem for name in chosen]
    for path in [*sorted((ROOT / "scenes").glob("*.toml")), *sorted((ROOT / "scenes" / "wires").glob("*.toml"))]:
        place = path.relative_to(ROOT).as_posix()
        kept = re.search(rf"^## {path.stem}\n.*?^Time: ([^\n]*)", old, re.DOTALL | re.MULTILINE)
        named = path.stem in names
        found = picture_of(path, PICTURES / f"{path.stem}.png", LONG if named else LIMIT) if named or not chosen else None
        time = found or (kept[1] if kept else "more than a minute")
        print(f"{place}: {time}", flush=True)
        entries.append(entry(path, place, time))
    PAGE.write_text(HEAD + "\n".join(entries), encoding="utf-8")


def entry(path: Path, place: str, time: str) -> str:
    """The section of a scene."""
    top = path.read_text(encoding="utf-8").split("\n\n")[0].splitlines()
    comment = " ".join(line.lstrip("# ") for line in top if line.startswith("# ") and not line.startswith(COMMAND))
    comment = re.sub(r"docs/([\w/]+\.md)", r"[docs/\1](\1)", comment)
    shown = (PICTURES / f"{path.stem}.png").exists()
    picture = f"![{path.stem}](images/gallery/{path.stem}.png)\n\n" if shown else ""
    command = f"```bash\n{command_of(path)}\n```"
    return f"## {path.stem}\n\n{comment}\n\n{command}\n\n{picture}Time: {time}\n"


def command_of(path: Path) -> str:
    """The command of a scene: the one in its first comment, as of a large panel that has a smaller one, or a plain one."""
    text = path.read_text(encoding="utf-8")
    if given := re.search(rf"^{COMMAND}(warpknit .*)$", text, re.MULTILINE):
        return given[1]
    command = "map" if re.search(r"^\[sweep\]", text, re.MULTILINE) else "run"
    return f"warpknit {command} {path.relative_to(ROOT).as_posix()}"


def picture_of(path: Path, picture: Path, limit: float) -> str | None:
    """Run a scene and keep a small copy of its picture; its time in words. None of a scene that takes longer than `limit` [s]."""
    with tempfile.TemporaryDirectory() as folder:
        command, _, *settings = shlex.split(command_of(path))[1:]
        planned = json.loads(warpknit("plan", str(path), *settings, "--json").stdout or "{}").get("wall_s")
        if planned is None or planned > limit:
            return None
        options = ["--device", "cpu", "--out", folder, "--force", "--set", "output.usd=false"]
        start = time.monotonic()
        try:
            done = warpknit(command, str(path), *settings, *options, timeout=2 * limit)
        except subprocess.TimeoutExpired:
            return None
        if done.returncode:
            return f"not run: {done.stderr.strip().splitlines()[-1]}"
        figures = FIGURES[::-1] if "[panel]" in path.read_text(encoding="utf-8") else FIGURES
        figure = next(file for name in figures if (file := Path(folder, "figures", f"{name}.png")).exists())
        thumbnail(figure, picture)
        file = next(file for name in ("summary", "map") if (file := Path(folder, f"{name}.json")).exists())
        summary = json.loads(file.read_text(encoding="utf-8"))
        return in_words(time.monotonic() - start if "reflection" in summary else summary["solver"]["wall_s"])


def in_words(wall: float) -> str:
    """A wall time [s] in two digits."""
    return f"{wall:.2g} s" if wall < 99.5 else f"{wall / 60:.2g} min"


def warpknit(*words: str, timeout: float = 2 * LIMIT) -> subprocess.CompletedProcess[str]:
    """The command line, without progress; compilation needs more than the limit."""
    quiet = ["--quiet"] if words[0] != "plan" else []
    return subprocess.run(
        [sys.executable, "-m", "warpknit", *words, *quiet], cwd=ROOT, check=False, capture_output=True, text=True, timeout=timeout
    )


def thumbnail(figure: Path, picture: Path) -> None:
    """A small copy of a figure, in 256 colours."""
    with Image.open(figure) as image:
        scale = max(WIDTH / image.width, HEIGHT / image.height)
        size = round(scale * image.width), round(scale * image.height)
        small = image.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    small.quantize(256, method=Image.Quantize.MAXCOVERAGE).save(picture, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:])
