"""What is installed: scenes by name, and the distributions, in an environment without the repository."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner

from warpknit import __version__, load_scene
from warpknit.base.errors import SceneError
from warpknit.commands.cli import main
from warpknit.scene.scene_loader import first_sentence, shipped_scenes

ROOT = Path(__file__).parents[1]
WHEEL_LIMIT = 2e6  # [bytes]
QUICK = ("--preset", "draft", "--set", "output.frames=1", "--set", "output.usd=false", "--set", "output.figures=false")


# --- scenes by name


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_scene_has_a_name_and_a_short_first_sentence() -> None:
    files = sorted((ROOT / "scenes").rglob("*.toml"))
    assert sorted(shipped_scenes().values()) == files
    assert all(10 < len(first_sentence(path)) <= 110 for path in files)


@pytest.mark.parametrize("name", ["atlas_patch", "plain_knit_cell"])
def test_a_scene_loads_by_name_in_any_folder(elsewhere: Path, name: str) -> None:
    assert load_scene(name) == load_scene(next((ROOT / "scenes").rglob(f"{name}.toml")))
    assert load_scene(name).name == name


def test_a_file_comes_before_a_scene_of_the_same_name(elsewhere: Path) -> None:
    Path("atlas_patch").write_text("[load]\nstrain_weft = 0.01\n")
    assert load_scene("atlas_patch").stages[-1].strain_weft == 0.01


def test_a_folder_does_not_hide_a_scene(elsewhere: Path) -> None:
    Path("atlas_cell").mkdir()
    assert load_scene("atlas_cell").stages[-1].strain_weft == 0.1


def test_an_unknown_name_gives_the_nearest(elsewhere: Path) -> None:
    with pytest.raises(SceneError, match=r"^atlas_pach: .*\batlas_patch$"):
        load_scene("atlas_pach")


def test_the_list_has_every_scene() -> None:
    listed = CliRunner().invoke(main, ["new", "--list"]).stdout.splitlines()
    assert {line.split()[0] for line in listed[-len(shipped_scenes()) :]} == set(shipped_scenes())


def test_a_scene_is_copied_to_start_from(elsewhere: Path) -> None:
    done = CliRunner().invoke(main, ["new", "mine", "--from", "atlas_patch"])
    assert done.exit_code == 0, done.stderr
    assert load_scene("mine.toml").changed({"name": "atlas_patch"}) == load_scene("atlas_patch")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--from", "atlas_pach"], "atlas_patch"),
        (["--from", "plain_knit_cell"], "wires.file"),
        (["--from", "heat", "--ends", "4"], "--ends"),
    ],
)
def test_what_cannot_be_copied_is_status_2(elsewhere: Path, arguments: list[str], said: str) -> None:
    done = CliRunner().invoke(main, ["new", *arguments])
    assert done.exit_code == 2 and said in done.stderr
    assert not list(elsewhere.iterdir())


# --- distributions


def python(program: Path | str, *arguments: object, folder: Path) -> str:
    """Standard output of a Python in a folder, without the repository on its path."""
    kept = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
    command = [os.fspath(program), *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, env=kept, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """An sdist, and the wheel built from it."""
    folder = tmp_path_factory.mktemp("dist")
    python(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, folder=folder)
    return sorted(folder.iterdir())


def environment(folder: Path, *package: object) -> Path:
    """The Python of a new environment with a package, and the installed dependencies."""
    python(sys.executable, "-m", "venv", folder, folder=folder.parent)
    (packages,) = folder.glob("lib/python*/site-packages")
    (packages / "dependencies.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    program = folder / "bin" / "python"
    python(program, "-m", "pip", "install", "--no-deps", "--no-index", "--no-build-isolation", *package, folder=folder)
    return program


def files_in(folder: str) -> list[Path]:
    """All files in a folder of the project, but for what Python leaves beside its modules."""
    return [path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts]


@pytest.mark.slow
def test_the_distributions_are_valid_and_small(distributions: list[Path]) -> None:
    python(sys.executable, "-m", "twine", "check", "--strict", *distributions, folder=distributions[0].parent)
    sdist, wheel = sorted(distributions, key=lambda path: path.suffix)
    assert wheel.name == f"warpknit-{__version__}-py3-none-any.whl" and sdist.name == f"warpknit-{__version__}.tar.gz"
    assert wheel.stat().st_size <= WHEEL_LIMIT
    folders = {"warpknit": "warpknit", "kernels": "warpknit/kernels", "scenes": "warpknit/scenes"}
    files = {f"{place}/{path.relative_to(ROOT / name).as_posix()}" for name, place in folders.items() for path in files_in(name)}
    with zipfile.ZipFile(wheel) as archive:
        assert {name for name in archive.namelist() if ".dist-info/" not in name} == files


@pytest.mark.slow
@pytest.mark.parametrize("is_editable", [False, True], ids=["wheel", "editable"])
def test_an_installed_package_runs_above_a_clone(distributions: list[Path], tmp_path: Path, is_editable: bool) -> None:
    """The folder `warpknit` of the clone, which holds no module, does not hide the package."""
    package = ["--editable", ROOT] if is_editable else [next(path for path in distributions if path.suffix == ".whl")]
    program = environment(tmp_path / "environment", *package)
    (tmp_path / "warpknit").symlink_to(ROOT)
    place = Path(python(program, "-c", "import warpknit; print(warpknit.__file__)", folder=tmp_path).strip())
    assert place.is_relative_to(ROOT if is_editable else tmp_path / "environment")
    assert python(program, "-m", "warpknit", "--version", folder=tmp_path) == f"warpknit {__version__}\n"
    assert "\natlas_patch " in python(program, "-m", "warpknit", "new", "--list", folder=tmp_path)
    python(program, "-m", "warpknit", "run", "atlas_cell", *QUICK, folder=tmp_path)
    assert (tmp_path / "runs" / "atlas_cell" / "summary.json").is_file()
