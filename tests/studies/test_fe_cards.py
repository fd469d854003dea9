"""The cards for FE codes: read back by other readers, and run by CalculiX where it is installed."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference.in_words import quantities
from warpknit.results.row import Row
from warpknit.runner.run_directory import OUTPUT_NAMES
from warpknit.scene import load_scene
from warpknit.studies.card import MaterialCard
from warpknit.studies.card_files import write_card
from warpknit.studies.fe_card import ENGINEERING, GREEN, LOGARITHMIC, TRUE, _rising, tangent
from warpknit.studies.fe_codes import CODES, FILES, limit_of_curves, missing_cards, write_fe_cards

SCENE = load_scene(Path(__file__).parents[2] / "scenes" / "contact_map.toml")
CARD = MaterialCard(
    strain_weft=0.10, strain_warp=0.14, tension_weft=0.06, tension_warp=0.09,
    stiffness=np.array([[1.71, 1.49, 0.02], [1.49, 1.48, -0.01], [0.02, -0.01, 0.55]]), asymmetry=0.0, step_difference=0.0,
    expansion=np.array([4.5e-6, 5.1e-6, 1e-7]), areal_mass=0.0087, stress_max=1e8, active_percent=66.0, temperature=293.15,
)  # fmt: skip
PATH = [
    Row(strain_weft=share * 0.10, strain_warp=share * 0.14, tension_weft_N_per_m=weft, tension_warp_N_per_m=warp)
    for share, weft, warp in ((0.3, -1e-6, 0.002), (0.6, 0.01, 0.02), (0.9, 0.008, 0.06), (1.1, 0.1, 0.12))
]
C, S = CARD.stiffness, np.array([CARD.tension_weft, CARD.tension_warp])
TO_MPA = 1e-3  # N/m over the nominal thickness of 1 mm
DENSITY = 0.0087 / 1e-3 * 1e-12  # [tonne/mm3]
KNITTED = 1.10 * 1.14  # area of the card over that as knitted
SIX_DIGITS = 5e-6  # what ten columns hold of a number with exponent; four of a density, 5e-5
NINE_DIGITS = 1e-8
CODE_NAMES = {"Abaqus", "LS-DYNA", "Radioss"}  # those with curves


@pytest.fixture
def cards(tmp_path):
    assert write_fe_cards(CARD, PATH, SCENE, "60 mN/m", tmp_path) == {name: code.file for name, code in CODES.items()}
    return {name: (tmp_path / code.file).read_text(encoding="ascii") for name, code in CODES.items()}


def in_plane(modulus: tuple[float, float], nu12: float) -> np.ndarray:
    """Stiffness (2, 2) of engineering constants."""
    compliance = np.array([[1.0 / modulus[0], -nu12 / modulus[0]], [-nu12 / modulus[0], 1.0 / modulus[1]]])
    return np.linalg.inv(compliance)


def nominal_stress(gradient: np.ndarray, stiffness: np.ndarray = C) -> np.ndarray:
    """P = F (S + C E) [N/m], what the card means: forces per width of the tensioned mesh."""
    strain = 0.5 * (gradient.T @ gradient - np.eye(2))
    s = stiffness @ np.array([strain[0, 0], strain[1, 1], 2.0 * strain[0, 1]])
    return gradient @ (np.diag(S) + np.array([[s[0], s[2]], [s[2], s[1]]]))


def conjugate_stress(measure, strain: np.ndarray) -> np.ndarray:
    """Stress of the card in `measure`, from U = stretch of the strain (3,) in that measure."""
    e, m = np.array([[strain[0], 0.5 * strain[2]], [0.5 * strain[2], strain[1]]]), measure.exponent
    values, vectors = np.linalg.eigh(e)
    stretches = np.exp(values) if m == 0.0 else (1.0 + 2.0 * m * values) ** (0.5 / m)
    u = vectors @ np.diag(stretches) @ vectors.T
    p = nominal_stress(u)  # without rotation
    if m == 1.0:
        t = np.linalg.solve(u, p)
    elif m == 0.5:
        t = 0.5 * (p + p.T)
    else:
        t = p @ u / (np.linalg.det(u) if measure.keeps_thickness else 1.0)  # Kirchhoff, or true stress
    return np.array([t[0, 0], t[1, 1], 0.5 * (t[0, 1] + t[1, 0])])


@pytest.mark.parametrize("measure", [GREEN, ENGINEERING, LOGARITHMIC, TRUE], ids=lambda measure: measure.text)
def test_the_tangent_of_a_measure_is_the_slope_of_its_stress(measure):
    """Central differences of T(E_m) at the prestress; error of second order in the step, some C step^2."""
    step = 1e-5
    slopes = [
        (conjugate_stress(measure, step * axis) - conjugate_stress(measure, -step * axis)) / (2.0 * step) for axis in np.eye(3)
    ]
    found = np.array(slopes).T
    assert tangent(CARD, measure) == pytest.approx(0.5 * (found + found.T), abs=1e-8)
    if not measure.keeps_thickness:
        assert found == pytest.approx(found.T, abs=1e-8)
    else:  # what an elastic law cannot hold, and the file says
        assert found[1, 0] - found[0, 1] == pytest.approx(S[0] - S[1], abs=1e-8)


def test_nastran_by_pynastran(cards, tmp_path, monkeypatch):
    monkeypatch.setattr(np, "in1d", np.isin, raising=False)  # NumPy 2 has no in1d, which pyNastran imports
    reader = pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran is not installed")
    bulk = reader.BDF(debug=None)
    bulk.read_bdf(str(tmp_path / CODES["nastran"].file), punch=True)
    for identity, measure in ((1, GREEN), (2, ENGINEERING)):
        expected = TO_MPA * tangent(CARD, measure)
        shell = bulk.properties[identity]
        material = shell.mid1_ref
        assert (material.type, shell.t, shell.mid2, shell.mid3) == ("MAT2", 1.0, None, None)
        found = [material.G11, material.G12, material.G13, material.G22, material.G23, material.G33]
        assert found == pytest.approx(expected[np.triu_indices(3)], rel=NINE_DIGITS)
        assert expected @ [material.a1, material.a2, material.a3] == pytest.approx(TO_MPA * C @ CARD.expansion, rel=NINE_DIGITS)
        assert (shell.MassPerArea(), material.tref) == pytest.approx((1e-9 * CARD.areal_mass, 293.15))  # tonne/mm2
        shell = bulk.properties[10 + identity]
        material = shell.mid1_ref
        assert (material.type, shell.t, shell.mid2) == ("MAT8", 1.0, None)
        assert in_plane((material.e11, material.e22), material.nu12) == pytest.approx(expected[:2, :2], rel=1e-7)
        assert (material.g12, material.rho, material.tref) == pytest.approx((expected[2, 2], DENSITY, 293.15))
        assert expected[:2, :2] @ [material.a1, material.a2] == pytest.approx(TO_MPA * (C @ CARD.expansion)[:2], rel=1e-7)


def keywords(text: str) -> list[tuple[str, list[list[str]]]]:
    """Keyword lines of Abaqus with their data lines, comments left out."""
    found: list[tuple[str, list[list[str]]]] = []
    for line in text.splitlines():
        if line.startswith("*") and not line.startswith("**"):
            found.append((line, []))
        elif not line.startswith("**"):
            found[-1][1].append([field.strip() for field in line.split(",")])
    return found


def test_abaqus_lamina(cards):
    data = dict(keywords(cards["abaqus"])[:4])
    assert list(data) == ["*MATERIAL, NAME=MESH", "*DENSITY", "*ELASTIC, TYPE=LAMINA", "*EXPANSION, TYPE=ORTHO"]
    e1, e2, nu12, g12, g13, g23 = map(float, data["*ELASTIC, TYPE=LAMINA"][0])
    expected = TO_MPA * tangent(CARD, LOGARITHMIC)
    assert in_plane((e1, e2), nu12) == pytest.approx(expected[:2, :2], rel=1e-7)
    assert (g12, g13, g23) == pytest.approx(3 * (expected[2, 2],))
    assert float(data["*DENSITY"][0][0]) == pytest.approx(DENSITY)
    alpha = [float(value) for value in data["*EXPANSION, TYPE=ORTHO"][0]]
    assert expected[:2, :2] @ alpha[:2] == pytest.approx(TO_MPA * (C @ CARD.expansion)[:2], rel=1e-7)


NODES = np.array([[0, 0], [10, 0], [20, 0], [0, 8], [9, 11], [20, 10], [0, 20], [11, 20], [20, 20]], dtype=float)  # [mm]
ELEMENTS = ((1, 2, 5, 4), (2, 3, 6, 5), (4, 5, 8, 7), (5, 6, 9, 8))
INNER = 5  # the node that is free
POINTS = 8  # integration points of an M3D4


def run_patch(folder: Path, material: list[str], gradient: np.ndarray, prestress: np.ndarray, warming: float, nonlinear: bool):
    """Mean nominal stress [N/m] of a patch of four membranes under a linear displacement of its edge, by CalculiX.

    P = sum of f_i X_j over the nodes, over the area.
    """
    ccx = shutil.which("ccx")
    if ccx is None:
        pytest.skip("CalculiX (ccx) is not installed")
    lines = ["*NODE, NSET=ALL", *(f"{n}, {x}, {y}, 0." for n, (x, y) in enumerate(NODES, start=1))]
    lines += ["*ELEMENT, TYPE=M3D4, ELSET=ALL", *(f"{n}, {str(nodes)[1:-1]}" for n, nodes in enumerate(ELEMENTS, start=1))]
    lines += [*material, "*ORIENTATION, NAME=AXES", "1., 0., 0., 0., 1., 0."]
    lines += ["*MEMBRANE SECTION, ELSET=ALL, MATERIAL=MESH, ORIENTATION=AXES", "1."]
    lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "ALL, 293.15", "*INITIAL CONDITIONS, TYPE=STRESS"]
    s1, s2 = (f"{s:.9g}" for s in TO_MPA * prestress)  # a field of CalculiX ends after 20 characters
    lines += [f"{n}, {point}, {s1}, {s2}, 0., 0., 0., 0." for n in range(1, 5) for point in range(1, POINTS + 1)]
    lines += [
        "*STEP, NLGEOM" if nonlinear else "*STEP",
        "*STATIC",
        "*TEMPERATURE",
        f"ALL, {293.15 + warming}",
        "*BOUNDARY",
        "ALL, 3",
    ]
    for n, place in enumerate(NODES, start=1):
        if n != INNER:
            lines += [f"{n}, {k}, {k}, {u:.12g}" for k, u in enumerate((gradient - np.eye(2)) @ place, start=1)]
    lines += ["*NODE PRINT, NSET=ALL", "RF", "*END STEP", ""]
    (folder / "patch.inp").write_text("\n".join(lines))
    done = subprocess.run([ccx, "patch"], cwd=folder, check=False, capture_output=True, text=True, timeout=60)
    rows = re.findall(r"^ +(\d+) +(\S+) +(\S+) +\S+$", (folder / "patch.dat").read_text(), flags=re.MULTILINE)
    assert len(rows) == len(NODES), done.stdout
    force = np.array([[float(x), float(y)] for _, x, y in rows])
    return force.T @ NODES / 400.0 / TO_MPA


@pytest.mark.parametrize(("strain", "warming"), [((1e-3, 0, 0), 0), ((0, 1e-3, 0), 0), ((0, 0, 2e-3), 0), ((0, 0, 0), -50)])
def test_calculix_runs_the_abaqus_card(cards, tmp_path, strain, warming):
    """CalculiX has no LAMINA: the same constants go to ENGINEERING CONSTANTS, with nothing through the thickness. In a linear
    step without prestress the tension is that of the tangent for true stress, C_0 (e - alpha_0 T), where C_0 alpha_0 = C alpha.
    Tolerance: seven digits are printed, six of which differences of nodal forces keep."""
    blocks = dict(keywords(cards["abaqus"])[:4])
    e1, e2, nu12, g12, *_ = blocks["*ELASTIC, TYPE=LAMINA"][0]
    material = [
        "*MATERIAL, NAME=MESH",
        "*ELASTIC, TYPE=ENGINEERING CONSTANTS",
        f"{e1}, {e2}, {e1}, {nu12}, 0., 0., {g12}, {g12},",
        g12,
    ]
    material += ["*EXPANSION, TYPE=ORTHO, ZERO=293.15", ", ".join(blocks["*EXPANSION, TYPE=ORTHO"][0])]
    gradient = np.eye(2) + np.array([[strain[0], strain[2]], [0.0, strain[1]]])
    found = run_patch(tmp_path, material, gradient, np.zeros(2), warming, nonlinear=False)
    uncoupled = tangent(CARD, LOGARITHMIC)
    uncoupled[:2, 2] = uncoupled[2, :2] = 0.0
    expected = uncoupled @ np.array(strain, dtype=float)
    expected[:2] -= warming * (C @ CARD.expansion)[:2]
    largest = np.abs(expected).max()
    assert [found[0, 0], found[1, 1], found[0, 1]] == pytest.approx(expected, abs=1e-5 * largest)


@pytest.mark.parametrize(
    ("gradient", "warming"),
    [([[1.01, 0.0], [0.0, 1.0]], 0.0), ([[1.0, 0.0], [0.0, 0.99]], 0.0), ([[1.01, 0.02], [0.0, 1.005]], 0.0), (np.eye(2), -50.0)],
)
def test_calculix_returns_the_tension_of_the_card_under_prestress(cards, tmp_path, gradient, warming):
    """P = F (S + C (E - alpha T)) for a finite strain: prestress, tangent and geometric stiffness at once, and the check value of
    the heading. CalculiX squares the thermal strain too: alpha T/2 = 1e-4 of it."""
    gradient = np.array(gradient)
    material = [line for line in cards["calculix"].splitlines() if not line.startswith("**")]
    found = run_patch(tmp_path, material, gradient, S, warming, nonlinear=True)
    uncoupled = C.copy()
    uncoupled[:2, 2] = uncoupled[2, :2] = 0.0
    heat = np.diag(warming * (C @ CARD.expansion)[:2])
    assert found == pytest.approx(
        nominal_stress(gradient, uncoupled) - gradient @ heat, abs=1e-6 + 2e-4 * abs(warming) * np.abs(C @ CARD.expansion).max()
    )
    if gradient[0, 0] == 1.01 and gradient[0, 1] == 0.0:
        along, across = (float(x) for x in re.findall(r"(\S+) e\s", cards["calculix"].replace("\n** ", " "))[-2:])
        growth = (np.diag(found) - S) * 1e-3 / 0.01  # [N/mm] by strain; of second order in the strain: C11 3/2 e
        assert growth == pytest.approx([along, across], rel=0.016)


def test_ansys_commands(cards):
    commands = [line.split(",") for line in cards["ansys"].splitlines() if not line.startswith("!")]
    mp = {name: float(value) for command, name, _, value in (c for c in commands if c[0] == "MP")}
    expected = TO_MPA * tangent(CARD, LOGARITHMIC)
    assert in_plane((mp["EX"], mp["EY"]), mp["PRXY"]) == pytest.approx(expected[:2, :2], rel=1e-7)
    assert (mp["GXY"], mp["DENS"], mp["REFT"]) == pytest.approx((expected[2, 2], DENSITY, 293.15))
    assert expected[:2, :2] @ [mp["ALPX"], mp["ALPY"]] == pytest.approx(TO_MPA * (C @ CARD.expansion)[:2], rel=1e-7)
    assert ["SECDATA", "1", "1"] in commands and ["KEYOPT", "1", "1", "1"] in commands
    xy, xz, yz = -mp["PRXY"] / mp["EX"], -mp["PRXZ"] / mp["EX"], -mp["PRYZ"] / mp["EY"]
    compliance = np.array([[1 / mp["EX"], xy, xz], [xy, 1 / mp["EY"], yz], [xz, yz, 1 / mp["EZ"]]])
    assert np.linalg.eigvalsh(compliance).min() > 0.0
    assert compliance[:, :2].sum(axis=0) == pytest.approx([0.0, 0.0], abs=1e-6 * compliance.max())  # the volume is kept
    prestress = next(line for line in cards["ansys"].splitlines() if "INISTATE,DEFINE" in line).split(",")
    assert [float(x) for x in prestress[6:8]] == pytest.approx(TO_MPA * S)


def columns(line: str, *widths: int) -> list[float | None]:
    """Fields of fixed width; None where blank."""
    ends = np.cumsum(widths)
    fields = (line[end - width : end].strip() for end, width in zip(ends, widths, strict=True))
    return [float(field) if field else None for field in fields]


def tension_at_the_card(strain: np.ndarray, stress: np.ndarray, axis: int, second_piola: bool) -> float:
    """True tension [N/m] of a curve at the strain of the card."""
    stretch, across = (1.10, 1.14)[axis], (1.14, 1.10)[axis]
    at = 0.5 * (stretch**2 - 1.0) if second_piola else stretch - 1.0
    assert np.isclose(strain, at, rtol=1e-9).any() and strain[0] == stress[0] == 0.0  # a point of the curve
    assert (np.diff(strain) > 0.0).all() and (np.diff(stress) > 0.0).all()
    nominal = np.interp(at, strain, stress) * (stretch if second_piola else 1.0) / TO_MPA
    return nominal / across


def test_lsdyna_columns(cards):
    lines = [line for line in cards["lsdyna"].splitlines() if not line.startswith("$")]
    assert max(map(len, lines)) <= 80 and lines[0] == "*KEYWORD" and lines[-1] == "*END"
    assert columns(lines[3], *4 * [10]) == [1.0, 1.0, 1.0, 1.0]
    starts = [n for n, line in enumerate(lines) if line == "*MAT_FABRIC_TITLE"]
    (mid, ro, ea, eb, _, prba, prab, _), (gab, *_), (aopt, *_, form, _, _), (_, _, _, a1, a2, a3, _, _) = (
        columns(line, *8 * [10]) for line in lines[starts[0] + 2 : starts[0] + 6]
    )
    assert (mid, form, aopt, a1, a2, a3) == (1, 0, 2, 1, 0, 0)
    expected = TO_MPA * tangent(CARD, TRUE)
    assert prba * ea == pytest.approx(prab * eb, rel=2 * SIX_DIGITS)  # PRBA: contraction along a over extension along b
    assert in_plane((ea, eb), prab) == pytest.approx(expected[:2, :2], rel=20 * SIX_DIGITS)  # nearly singular: an inverse
    assert gab == pytest.approx(expected[2, 2], rel=SIX_DIGITS) and ro == pytest.approx(DENSITY, rel=1e-4)
    (mid, ro, *_), (gab, *_), (*_, form, _, _) = (columns(line, *8 * [10]) for line in lines[starts[1] + 2 : starts[1] + 5])
    assert (mid, form) == (2, 14) and ro == pytest.approx(KNITTED * DENSITY, rel=1e-4)
    assert gab == pytest.approx(TO_MPA * C[2, 2] / KNITTED, rel=SIX_DIGITS)
    assert columns(lines[starts[1] + 7], 10, 10) == [1, 2]
    note = re.search(r"size times (\S+) along a and (\S+) along b, with RO = (\S+),", cards["lsdyna"].replace("\n$ ", " "))
    built, preloaded = np.array([float(note[1]), float(note[2])]), float(note[3])
    assert expected[:2, :2] @ -np.log(built) == pytest.approx(TO_MPA * S, rel=1e-7)  # log strain from there to the card
    assert preloaded * built.prod() == pytest.approx(DENSITY)
    for axis, block in enumerate("\n".join(lines).split("*DEFINE_CURVE\n")[1:]):
        identity, *points = block.splitlines()
        assert float(identity) == axis + 1
        curve = np.array([columns(line, 20, 20) for line in points if not line.startswith("*")]).T
        assert tension_at_the_card(*curve, axis, second_piola=True) == pytest.approx(S[axis], rel=1e-9)


def test_lsdyna_by_pydyna(cards):
    """The reader of Ansys gives every value to the keyword that the manual gives it to."""
    deck = pytest.importorskip("ansys.dyna.core", reason="ansys-dyna-core is not installed").Deck()
    deck.loads(cards["lsdyna"])
    assert [f"{k.keyword}_{k.subkeyword}" for k in deck.all_keywords] == [
        "SECTION_SHELL",
        *2 * ["MAT_FABRIC"],
        *2 * ["DEFINE_CURVE"],
    ]
    section, linear, fabric, *curves = deck.all_keywords
    assert (section.elform, section.t1, section.t4) == (5, 1.0, 1.0)
    expected = TO_MPA * tangent(CARD, TRUE)
    assert (linear.mid, linear.title, linear.form, linear.cse, linear.aopt, linear.a1) == (1, "MESH", 0, 0.0, 2.0, 1.0)
    assert in_plane((linear.ea, linear.eb), linear.prab) == pytest.approx(expected[:2, :2], rel=20 * SIX_DIGITS)
    assert linear.prba / linear.eb == pytest.approx(linear.prab / linear.ea, rel=2 * SIX_DIGITS)
    assert (linear.gab, linear.ro) == pytest.approx((expected[2, 2], DENSITY), rel=1e-4)
    assert (fabric.mid, fabric.form, fabric.lca, fabric.lcb) == (2, 14, 1, 2)
    assert (fabric.gab, fabric.ro) == pytest.approx((TO_MPA * C[2, 2] / KNITTED, KNITTED * DENSITY), rel=1e-4)
    for axis, curve in enumerate(curves):
        strain, stress = curve.curves.to_numpy(dtype=float).T
        assert curve.lcid == axis + 1
        assert tension_at_the_card(strain, stress, axis, second_piola=True) == pytest.approx(S[axis], rel=1e-9)


def test_radioss_columns(cards):
    lines = [line for line in cards["radioss"].splitlines() if not line.startswith("#")]
    assert lines[0] == "/UNIT/1" and lines[2].split() == ["Mg", "mm", "s"] and lines[3] == "/MAT/LAW58/1/1"
    (rho,), (e1, _, e2, _, _), (g0, gt) = columns(lines[5], 20), columns(lines[6], *5 * [20]), columns(lines[7], 20, 20)
    assert rho == pytest.approx(KNITTED * DENSITY) and g0 == gt == pytest.approx(TO_MPA * C[2, 2])
    n1, n2, crimp_1, crimp_2, *_ = columns(lines[9], 10, 10, *4 * [20])
    assert n1 == n2 == 1 and 0.0 < crimp_1 == crimp_2 <= 1e-6
    assert [columns(line, 10, 10, 20) for line in lines[10:12]] == [[1, None, 1.0], [2, None, 1.0]]
    blocks = "\n".join(lines).split("/FUNCT/")[1:]
    for axis, (block, modulus) in enumerate(zip(blocks, (e1, e2), strict=True)):
        identity, _, *points = block.splitlines()
        curve = np.array([columns(line, 20, 20) for line in points]).T
        assert int(identity) == axis + 1 and modulus == pytest.approx((np.diff(curve[1]) / np.diff(curve[0])).max())
        assert tension_at_the_card(*curve, axis, second_piola=False) == pytest.approx(S[axis], rel=1e-9)


def test_abaqus_fabric(cards):
    blocks = keywords(cards["abaqus"])[4:]
    assert [line for line, _ in blocks[:3]] == ["*MATERIAL, NAME=FABRIC", "*DENSITY", "*FABRIC"]
    assert float(blocks[1][1][0][0]) == pytest.approx(KNITTED * DENSITY)
    for axis, component in enumerate("12"):
        assert blocks[3 + 2 * axis][0] == f"*UNIAXIAL, COMPONENT={component}"
        assert blocks[4 + 2 * axis][0].endswith("EXTRAPOLATION=LINEAR")  # the default is a constant stress beyond the last point
        stress, strain = np.array(blocks[4 + 2 * axis][1], dtype=float).T
        assert tension_at_the_card(strain, stress, axis, second_piola=False) == pytest.approx(S[axis], rel=NINE_DIGITS)
    assert [float(x) for x in blocks[8][1][1]] == pytest.approx([TO_MPA * C[2, 2] * KNITTED, 1.0])


def test_a_code_that_cannot_hold_the_card_gets_none(tmp_path):
    """MAT2 takes any matrix; where prestress makes the tangent of true stress stable, the constants of Abaqus exist too."""
    unstable = replace(CARD, stiffness=np.array([[1.5, 1.55, 0.0], [1.55, 1.5, 0.0], [0.0, 0.0, -0.01]]))
    found = write_fe_cards(unstable, PATH, SCENE, "", tmp_path, warnings=["a warning of the map"])
    assert found["calculix"].startswith("none: its stiffness for second Piola") and "shear" in found["radioss"]
    assert found["nastran"] in FILES and found["abaqus"] in FILES
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(name for name in found.values() if name in FILES)
    bulk = (tmp_path / found["nastran"]).read_text(encoding="ascii")
    assert "MAT8 11: none" in bulk and "MAT8*                 11" not in bulk and "a warning of the map" in bulk
    assert "not positive definite" in bulk.replace("\n$ ", " ")
    assert "NAME=FABRIC" not in (tmp_path / found["abaqus"]).read_text(encoding="ascii")


@pytest.mark.parametrize(
    ("card", "path", "why"),
    [
        (replace(CARD, jumps="the mesh jumps"), PATH, "the mesh snaps through to another equilibrium on the way to the card"),
        (
            CARD,  # a slack weft contracts while the tension rises
            [Row(strain_weft=0.12, strain_warp=0.02, tension_weft_N_per_m=0.01, tension_warp_N_per_m=0.01), PATH[-1]],
            "the tension in weft does not rise with the strain in weft on the way to the card",
        ),
    ],
)
def test_curves_cross_no_jump_and_drop_no_state_that_matters(tmp_path, card, path, why):
    found = write_fe_cards(card, path, SCENE, "", tmp_path)
    assert found["radioss"] == f"none: {why}"
    assert f"no card for radioss: {why}" in missing_cards(found)
    text = (tmp_path / found["abaqus"]).read_text(encoding="ascii")
    assert f"FABRIC: none, {why}." in text.replace("\n** ", " ") and "NAME=FABRIC" not in text


def test_curves_that_end_say_where_and_why():
    """PATH goes on to 110 mN/m, the card is at 75 mN/m. Nastran has no curves, so nothing is said of them."""
    assert list(limit_of_curves(CARD, PATH, ["nastran", "abaqus"], at_jump=False)) == []
    (beyond,) = limit_of_curves(CARD, PATH, ["abaqus", "radioss"], at_jump=True)
    assert quantities(beyond.text) == ["110 mN/m"]
    (at_card,) = limit_of_curves(CARD, PATH[:-1], list(CODES), at_jump=False)
    assert "75 mN/m" in quantities(at_card.text) and at_card.text.endswith("did not converge beyond the card.")
    assert list(limit_of_curves(CARD, PATH, ["nastran"], at_jump=True)) == []


def test_codes_can_be_chosen_and_files_are_those_of_a_report(tmp_path):
    assert list(write_fe_cards(CARD, PATH, SCENE, "", tmp_path, codes=["ansys"])) == ["ansys"]
    assert [path.name for path in tmp_path.iterdir()] == [CODES["ansys"].file]
    assert set(FILES) <= set(OUTPUT_NAMES)
    assert json.dumps(list(CODES)) == '["nastran", "abaqus", "calculix", "ansys", "lsdyna", "radioss"]'


def test_every_file_says_that_the_wire_would_break(tmp_path):
    """As a comment, in each code: a stress of 9 GPa is above any strength."""
    files = write_fe_cards(replace(CARD, stress_max=9e9), PATH, SCENE, "", tmp_path)
    for code, file in files.items():
        lines = (tmp_path / file).read_text(encoding="ascii").splitlines()
        mark = next(line for line in lines if "W56 At the tension of the card" in line).split()[0]
        comment = " ".join(line.removeprefix(mark).strip() for line in lines if line.startswith(mark))
        assert "9 GPa" in quantities(comment), code


def test_a_card_tells_wire_knit_preset_and_what_the_preset_is_worth(tmp_path):
    """In every file: a tight knit at the draft preset is far from the reference preset at one of ten loads."""
    wire = {"material": "molybdenum", "diameter": "30 um", "plating": {"material": "gold", "thickness": "0.2 um"}}
    knit = {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"}
    boundary, preset = {"boundary": "periodic"}, {"preset": "draft"}
    scene = load_scene({"wire": wire, "knit": knit, "model": boundary, "load": {"strain_warp": 0.1}, "solver": preset})
    files = write_fe_cards(CARD, PATH, scene, "60 mN/m", tmp_path)
    write_card(CARD, scene, "60 mN/m", tmp_path, (), files)
    card = json.loads((tmp_path / "material_card.json").read_text())
    assert quantities(card["wire"]) == ["30 um", "0.2 um"]
    assert quantities(card["knit"]) == ["1", "0", "1", "2", "1", "2", "1", "0", "26", "30"]
    assert card["preset"].startswith("draft, ")
    table = (tmp_path / "material_card.csv").read_text()
    assert all(text in table for text in (card["wire"], card["knit"], card["preset"], scene.preset_caveat))
    for name in files.values():
        comments = " ".join(re.sub(r"^\W+", "", line) for line in (tmp_path / name).read_text().splitlines())
        assert "Wire: molybdenum, 30 um" in comments


def test_a_curve_of_a_direction_that_contracts_first_begins_no_steeper_than_it_goes_on() -> None:
    """A tension at next to no strain, of a mesh that was shorter before, is left out: a line from the mesh as knitted."""
    stretch = np.array([1.08, 0.999, 1.0 + 4e-5, 1.02, 1.05])
    nominal = np.array([5.0, 0.02, 0.1, 1.2, 3.0])  # of the card, then of the states on the way
    curve = _rising("warp", stretch, nominal)
    assert curve.stretch.tolist() == [1.0, 1.02, 1.05, 1.08] and curve.slope < 70.0
