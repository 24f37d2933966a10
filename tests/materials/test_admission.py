"""Laws of a user's own: what each check at the door turns away, and which files may have code run."""

import json
import multiprocessing
import pickle
import tomllib
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import ngsolve as ngs
import pytest

from ngbrain.cli import main
from ngbrain.errors import InputError
from ngbrain.materials import HolzapfelGasserOgden, named, registry
from ngbrain.materials.admission import admit
from ngbrain.materials.named import NamedLaw
from ngbrain.materials.registry import REGISTRY
from ngbrain.scene import Scene

FILE = '''
from dataclasses import dataclass

import ngsolve as ngs


@dataclass(frozen=True)
class Quartic:
    """W = μ/2 (I₁ - 3) + μ k (I₁ - 3)²."""

    mu_Pa: float
    k: float = 0.5

    @property
    def initial_modulus(self):
        return self.mu_Pa

    def energy(self, C):
        beyond = ngs.Trace(C) - 3
        return self.mu_Pa / 2 * beyond + self.mu_Pa * self.k * beyond**2
'''
SCENE = """
[geometry]
kind = "block"
size_mm = [20, 20, 20]
[mesh]
max_size_mm = 20
[[tissue]]
material = { MATERIAL }
poissons_ratio = 0.3
[[displacement_bc]]
boundary = "bottom"
[[displacement_bc]]
boundary = "top"
value_mm = [0, 0, -0.1]
[[quantity]]
name = "force"
boundary = "top"
tolerance = 0.5
"""
BY_PATH, BY_NAME = 'path = "laws/mine.py:Quartic", mu_Pa = 900.0', 'name = "Quartic", mu_Pa = 900.0'


@pytest.fixture(autouse=True)
def unknown(monkeypatch):
    """What a test registers or runs is forgotten."""
    monkeypatch.setattr(registry, "_loaded", {})
    named._admitted.cache_clear()
    before = dict(REGISTRY)
    yield
    REGISTRY.clear()
    REGISTRY.update(before)


@pytest.fixture
def case(tmp_path):
    """A folder with a scene, and laws beside it."""
    (tmp_path / "laws").mkdir()
    (tmp_path / "laws" / "mine.py").write_text(FILE)
    (tmp_path / "scene.toml").write_text(SCENE.replace("MATERIAL", BY_PATH))
    (tmp_path / "named.toml").write_text(SCENE.replace("MATERIAL", BY_NAME))
    return tmp_path


@dataclass(frozen=True)
class Own:
    """μ/2 (I₁ - 3), and more that the checks are to find."""

    initial_modulus: float = 900.0
    mu: float = 900.0
    turned: float = 0.0
    pulled: float = 0.0
    squared: float = 0.0
    sheared: float = 0.0
    stretch: tuple[float, float] = (0.8, 1.25)

    def energy(self, C):
        """W (Pa)."""
        beyond = ngs.Trace(C) - 3
        return self.mu / 2 * beyond + self.squared * beyond**2

    def density(self, at):
        """W (Pa), with a part of F."""
        F = at.gradient if at.gradient is not None else ngs.Id(3)
        return (
            self.energy(at.shape)
            + self.turned * (F[0, 1] - F[1, 0]) ** 2
            + self.pulled * (at.C[0, 0] - 1)
            + self.sheared * at.C[0, 1] ** 2
        )


class Raises(Own):
    def energy(self, C):
        return ngs.Trace(C) + self.nothing


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (Own(turned=1e-3), r"Mine is not objective: W\(F\) = .* Pa where W\(QF\)"),
        (Own(pulled=0.01), r"Mine is a law with a stress of 0\.02 Pa at rest"),
        (Own(901.0), r"Mine\.initial_modulus is 901 Pa; wanted: 900"),
        (Own(900.0 * (1 + 2e-6)), r"Mine\.initial_modulus is 900\.002 Pa; wanted: 900"),
        (Own(sheared=-500.0), "Mine is a law that is not elliptic at rest"),
        (Own(None), r"Mine\.initial_modulus is missing"),
        (Own(stretch=(1.1, 1.2)), r"Mine\.stretch is \(1\.1, 1\.2\)"),
        (Own(squared=float("nan")), "without an energy at strains of 0.02"),
        (Raises(), "raises AttributeError"),
        (3.0, r"energy\(C\)"),
    ],
)
def test_what_is_turned_away(law, said):
    assert admit(Own(), "Mine") == [] == admit(Own(900.0 * (1 + 0.5e-6)), "Mine")
    with pytest.raises(InputError, match=said):
        admit(law, "Mine")


def test_where_ellipticity_is_lost_is_said():
    """μ/2 x + c x², c < 0: in plane strain until 6 |c| k² = μ/2, with the amount of shear k = λ - 1/λ."""
    soft = Own(squared=-900.0)
    k = (900 / 2 / (6 * 900)) ** 0.5
    lost = k / 2 + (1 + k * k / 4) ** 0.5
    said = admit(soft, "Mine")
    assert any("planar stretch of 1.1" in each for each in said) and all("Legendre-Hadamard" in each for each in said)
    found = min(float(each.split("stretch of ")[1].split()[0]) for each in said if "planar" in each and " 1." in each)
    assert lost < found < lost + 0.026
    assert admit(Own(squared=-900.0, stretch=(0.95, 1.05)), "Mine") == []


def test_a_law_with_fibres_has_its_modulus_in_one_plane():
    @dataclass(frozen=True)
    class Fibres(HolzapfelGasserOgden):
        initial_modulus: float = 500.0

    assert admit(Fibres(500.0, 2000.0, 5.0, 0.0, (1, 0, 0)), "Fibres") == []
    with pytest.raises(InputError, match="initial_modulus is 600 Pa; wanted: 500"):
        admit(Fibres(500.0, 2000.0, 5.0, 0.0, (1, 0, 0), 600.0), "Fibres")


def test_a_scene_names_its_law_by_path(case, monkeypatch):
    monkeypatch.chdir(case.parent)
    scene = Scene.from_toml(case / "scene.toml")
    assert Scene.from_dict(scene.to_dict()) == scene and scene.tissues[0].initial_modulus == pytest.approx(900.0)
    assert scene.to_dict()["tissue"][0]["material"] == {
        "path": f"{case / 'laws' / 'mine.py'}:Quartic",
        "mu_Pa": 900.0,
    }
    assert scene.tissues[0].material.values == (("mu_Pa", 900.0),)
    (case / "again.toml").write_text(scene.to_toml())
    assert Scene.from_toml(case / "again.toml") == scene


def test_no_scene_beside_a_result_has_code_run(case, tmp_path):
    """Nor one that comes as data; with the file given on the command line both are good."""
    (case / "laws" / "mine.py").write_text(FILE + f"open({str(case / 'ran')!r}, 'w').close()\n")
    (case / "result.json").write_text("{}")
    elsewhere = case / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "scene.toml").symlink_to(case / "scene.toml")
    for file in (case / "scene.toml", elsewhere / "scene.toml"):
        with pytest.raises(InputError, match=r"tissue#1\.material\.path is .*beside .*result\.json; wanted: no code"):
            Scene.from_toml(file)
    data = tomllib.loads(SCENE.replace("MATERIAL", f'path = "{case}/laws/mine.py:Quartic", mu_Pa = 900.0'))
    with pytest.raises(InputError, match="a scene that is not read from a file"):
        Scene.from_dict(data)
    assert not (case / "ran").exists()
    registry.register(case / "laws" / "mine.py")
    assert Scene.from_toml(case / "scene.toml").tissues[0].law() and (case / "ran").exists()
    (case / "result.json").unlink()


@pytest.mark.parametrize(
    ("text", "source", "said"),
    [
        (FILE, "laws/other.py:Quartic", "other.py, which does not exist"),
        (FILE, "laws/mine.py:Quintic", r"wanted: a class with `energy\(C\)` in it, .*'Quartic'"),
        (FILE, "laws/mine.py", r"wanted: FILE\.py:CLASS"),
        (FILE, "no_such_module:Quartic", "no_such_module, which ends in ModuleNotFoundError"),
        ("x = (", "laws/mine.py:Quartic", "SyntaxError"),
        ("raise SystemExit(3)", "laws/mine.py:Quartic", "SystemExit"),
        (
            FILE.replace("return self.mu_Pa\n", "return 2 * self.mu_Pa\n"),
            "laws/mine.py:Quartic",
            "initial_modulus is 1800 Pa",
        ),
        (FILE.replace("mu_Pa: float\n", "mu: float\n"), "laws/mine.py:Quartic", r"material\.mu_Pa is not a known key"),
        (FILE + "\n    def __post_init__(self):\n        1 / 0\n", "laws/mine.py:Quartic", "raises ZeroDivisionError"),
        (FILE + "    parameters = 3\n", "laws/mine.py:Quartic", r"Quartic\.parameters = 3"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(case, text, source, said):
    (case / "laws" / "mine.py").write_text(text)
    (case / "scene.toml").write_text(SCENE.replace("MATERIAL", f'path = "{source}", mu_Pa = 900.0'))
    with pytest.raises(InputError, match=said):
        Scene.from_toml(case / "scene.toml")


def test_an_importable_law_and_parameters_with_bounds(case, monkeypatch):
    lines = "\nfrom ngbrain.materials.registry import MU, Parameter\n\nclass Bounded(Quartic):\n"
    lines += "    parameters = (Parameter('mu_Pa', low=1.0, high=5.0),)\n"
    (case / "laws" / "__init__.py").write_text(FILE + lines)
    monkeypatch.syspath_prepend(case)
    (case / "scene.toml").write_text(SCENE.replace("MATERIAL", 'path = "laws:Bounded", mu_Pa = 2.0'))
    assert Scene.from_toml(case / "scene.toml").tissues[0].material.name == "laws:Bounded"
    (case / "scene.toml").write_text(SCENE.replace("MATERIAL", 'path = "laws:Bounded", mu_Pa = 9.0'))
    with pytest.raises(InputError, match=r"material\.mu_Pa is 9\.0; wanted: a number from 1 to 5"):
        Scene.from_toml(case / "scene.toml")


@pytest.mark.slow
def test_the_command_takes_laws_by_path_and_by_name(case, capsys):
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    assert main(["simulate", str(case / "named.toml"), "-o", str(case / "a"), "-q"]) == 2
    assert "material.name is 'Quartic'" in capsys.readouterr().err
    laws = str(case / "laws" / "mine.py")
    assert main(["simulate", str(case / "scene.toml"), "-o", str(case / "a"), "-q"]) in (0, 3)
    assert main(["simulate", str(case / "named.toml"), "--laws", laws, "-o", str(case / "b"), "-q"]) in (0, 3)
    values = [json.loads((case / each / "result.json").read_text())["answers"][0]["value"] for each in "ab"]
    assert values[0] == values[1] < 0
    assert main(["materials", "--laws", laws]) == 0
    assert "Quartic" in capsys.readouterr().out
    assert main(["materials", "--laws", str(case / "none.py")]) == 2
    assert "which does not exist" in capsys.readouterr().err


def test_names_that_are_taken(case):
    (case / "laws" / "mine.py").write_text(FILE.replace("Quartic", "Gent"))
    with pytest.raises(InputError, match="with another 'Gent'"):
        registry.register(case / "laws" / "mine.py")
    line = "from ngbrain.materials.registry import REGISTRY, LawEntry\nREGISTRY['Gent'] = LawEntry(Quartic, ())\n"
    (case / "laws" / "more.py").write_text(FILE + line)
    kept = REGISTRY["Gent"]
    with pytest.raises(InputError, match="with another 'Gent'"):
        registry.register(case / "laws" / "more.py")
    (case / "laws" / "empty.py").write_text("")
    with pytest.raises(InputError, match="without a law"):
        registry.register(case / "laws" / "empty.py")
    assert REGISTRY["Gent"] is kept


def _modulus(named: NamedLaw) -> float:
    return named.law().initial_modulus


def test_another_process_runs_the_file_too(case):
    """A name is not known there, and neither is what was run."""
    line = "from ngbrain.materials.registry import REGISTRY, LawEntry, Parameter\n"
    line += "REGISTRY['Mine'] = LawEntry(Quartic, (Parameter('mu_Pa'),))\n"
    (case / "laws" / "mine.py").write_text(FILE + line)
    assert registry.register(case / "laws" / "mine.py") == ["Mine"]
    named = NamedLaw.read({"name": "Mine", "mu_Pa": 700.0})
    by_path = NamedLaw.read({"path": f"{case}/laws/mine.py:Mine", "mu_Pa": 700.0})
    assert pickle.loads(pickle.dumps(named)) == named
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as other:
        assert list(other.map(_modulus, [named, by_path])) == [700.0, 700.0]
