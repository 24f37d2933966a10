"""Laws by name: what a file may say of them, and a law of one's own in a lab, a fit, a scene and an operation."""

from dataclasses import dataclass

import numpy as np
import pytest
from lopez_pamies import LINE, LopezPamies

from ngbrain.cli import main
from ngbrain.errors import InputError
from ngbrain.ladder.axes import axes_of, cheapest
from ngbrain.ladder.models.hierarchy import ModelHierarchy, solve
from ngbrain.materials import Demiray, Gent, HolzapfelGasserOgden, Maxwell, Ogden, Prony, Viscous, lab
from ngbrain.materials.families import shear_modulus
from ngbrain.materials.named import NamedLaw
from ngbrain.materials.registry import REGISTRY, LawEntry
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Time, Tissue

GIVEN = {
    "NeoHooke": {"mu_Pa": 900.0},
    "UnsplitNeoHooke": {"mu_Pa": 900.0},
    "MooneyRivlin": {"c10_Pa": 300.0, "c01_Pa": 150.0},
    "Yeoh": {"c1_Pa": 450.0, "c2_Pa": 200.0},
    "Gent": {"mu_Pa": 900.0, "jm": 2.0},
    "Demiray": {"mu_Pa": 900.0, "b": 3.0},
    "Ogden": {"mu_Pa": [600.0, 300.0], "alpha": [-4.0, 5.0]},
}
HEIGHT = 0.04


@dataclass(frozen=True)
class Fibres(HolzapfelGasserOgden):
    """A law with directions, which no Maxwell branch can have."""

    initial_modulus: float = 500.0


@pytest.fixture
def own(monkeypatch):
    monkeypatch.setitem(REGISTRY, *LINE)
    return {"name": "LopezPamies", "mu_Pa": 900.0, "a": 1.7}


def bar(material, stretch, **more):
    """A bar whose sides are free, to a stretch along its height."""
    sides = {"bottom": "z", "left": "x", "front": "y"}
    far = DisplacementBC(boundary="top", value=(0, 0, (stretch - 1) * HEIGHT), components="z")
    return Scene(
        geometry=Geometry(kind="block", size=(0.02, 0.03, HEIGHT)),
        mesh=MeshSize(largest=HEIGHT),
        tissues=(Tissue(material=material, poissons_ratio=0.4999, **more),),
        displacement_bcs=(*(DisplacementBC(boundary=b, components=c) for b, c in sides.items()), far),
        time=Time(ramp=2.0, end=20.0),
        quantities=(Quantity(name="force", boundary="top", tolerance=0.5),),
    )


@pytest.mark.parametrize("name", REGISTRY)
def test_a_law_is_read_written_and_pulled(name, tmp_path):
    scene = bar({"name": name, **GIVEN[name]}, 1.1)
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    assert Scene.from_toml(tmp_path / "scene.toml") == scene and Scene.from_dict(scene.to_dict()) == scene
    law = NamedLaw.read({"name": name, **GIVEN[name]}).law()
    assert scene.tissues[0].law().equilibrium == law and hash(scene)
    assert scene.tissues[0].initial_modulus == pytest.approx(float(shear_modulus(law)))
    found = solve(
        ModelHierarchy(scene), cheapest(axes_of(scene)) | {"space": "solid", "strain": "finite", "pressure": "unknown"}
    )
    wanted = float(lab.stress(law, "uniaxial", 1.1)) * 6e-4
    assert found.answers[0] == pytest.approx(wanted, rel=1e-3)


@pytest.mark.parametrize(
    ("material", "said"),
    [
        ({"name": "Gnet", "mu_Pa": 900.0}, r"tissue#1\.material\.name is 'Gnet'; .*'Gent'"),
        ({"mu_Pa": 900.0}, r"material\.name is missing"),
        ({"name": "Gent", "mu_Pa": 900.0}, r"material\.jm is missing; wanted: a number from 0\.001 to 1e\+06"),
        ({"name": "Gent", "mu_kPa": 0.9, "jm": 1.0}, r"material\.mu_kPa is not a known key; .*'mu_Pa'"),
        ({"name": "Gent", "mu_Pa": -1.0, "jm": 1.0}, r"material\.mu_Pa is -1\.0; wanted: a number in Pa"),
        ({"name": "Gent", "mu_Pa": [900.0], "jm": 1.0}, r"material\.mu_Pa is \[900\.0\]; wanted: a number in Pa"),
        ({"name": "Ogden", "mu_Pa": [1.0, 2.0], "alpha": 3.0}, "alpha"),
        ("griffiths2024:cortx", r"griffiths2024:cortex"),
        (3, "a name in the catalogue"),
    ],
)
def test_what_is_wrong_is_named(material, said):
    data = bar("griffiths2024:cortex", 1.1).to_dict()
    data["tissue"][0]["material"] = material
    with pytest.raises(InputError, match=said):
        Scene.from_dict(data)


def test_a_prony_series_belongs_to_a_law_that_does_not_relax():
    relaxing = Tissue(material={"name": "Gent", "mu_Pa": 900.0, "jm": 2.0}, prony_g=(0.4, 0.2), prony_tau=(1.0, 30.0))
    assert relaxing.law() == Prony(Gent(900.0, 2.0), (0.4, 0.2), (1.0, 30.0)) and relaxing.initial_modulus == 900.0
    for more, said in (
        ({"material": "griffiths2024:cortex", "prony_g": 0.4, "prony_tau": 1.0}, "is not viscoelastic itself"),
        ({"material": {"name": "NeoHooke", "mu_Pa": 1.0}, "prony_g": 0.4}, "prony_tau_s is missing"),
        ({"material": {"name": "NeoHooke", "mu_Pa": 1.0}, "prony_g": 1.0, "prony_tau": 1.0}, "less than 1"),
    ):
        with pytest.raises(InputError, match=said):
            Scene.from_dict(bar("griffiths2024:cortex", 1.1).to_dict() | {"tissue": [Tissue(**more).to_dict()]})
    scene = bar({"name": "Gent", "mu_Pa": 900.0, "jm": 2.0}, 0.93, prony_g=(0.4,), prony_tau=(3.0,))
    levels = {"space": "solid", "strain": "finite", "pressure": "unknown", "time": "prony"}
    found = solve(ModelHierarchy(scene), cheapest(axes_of(scene)) | levels).answers[0]
    times = np.concatenate([np.linspace(0, 2, 81), np.linspace(2, 20, 181)[1:]])
    history = lab.history(scene.tissues[0].law(), "uniaxial", times, 1 - 0.07 * np.minimum(times / 2.0, 1.0))
    assert found == pytest.approx(history[-1] * 6e-4, rel=5e-3)


def test_maxwell_branches_are_of_any_isotropic_law(tmp_path, own):
    branches = [{"name": "Demiray", "mu_Pa": 600.0, "b": 3.0, "eta_Pa_s": 1800.0}, {**own, "eta_Pa_s": 9000.0}]
    data = bar({"name": "Gent", "mu_Pa": 500.0, "jm": 2.0}, 0.93).to_dict()
    data["tissue"][0]["maxwell"] = branches
    scene = Scene.from_dict(data)
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    assert Scene.from_toml(tmp_path / "scene.toml") == scene and hash(scene)
    tissue, springs = scene.tissues[0], (Demiray(600.0, 3.0), LopezPamies(900.0, 1.7))
    assert tissue.law() == Viscous(Gent(500.0, 2.0), (Maxwell(springs[0], 1800.0), Maxwell(springs[1], 9000.0)))
    assert tissue.initial_modulus == pytest.approx(2000.0) and tissue.with_scale(2.0).initial_modulus == pytest.approx(
        4000.0
    )
    assert tissue.with_alpha(-4.7).law().maxwell_branches[0].law == Ogden(600.0, -4.7)
    levels = {"space": "solid", "strain": "finite", "pressure": "unknown", "time": "flowing"}
    assert axes_of(scene)["time"].levels[-1] == "flowing"
    found = solve(ModelHierarchy(scene), cheapest(axes_of(scene)) | levels).answers[0]
    times = np.concatenate([np.linspace(0, 2, 81), np.linspace(2, 20, 181)[1:]])
    history = lab.history(tissue.law(), "uniaxial", times, 1 - 0.07 * np.minimum(times / 2.0, 1.0))
    assert found == pytest.approx(history[-1] * 6e-4, rel=5e-3) and abs(history[-1]) < 0.5 * abs(history[80])
    (branch,), fibres = branches[:1], Fibres(500.0, 2000.0, 5.0, 0.0, (1, 0, 0))
    for more, said in (
        ({"maxwell": [{"name": "Demiray", "mu_Pa": 600.0, "b": 3.0}]}, r"maxwell\.eta_Pa_s is missing"),
        ({"maxwell": [branch | {"eta_Pa_s": 0}]}, r"maxwell\.eta_Pa_s is 0; wanted"),
        ({"maxwell": [branch | {"mu": 3}]}, r"maxwell\.mu is not a known key"),
        ({"maxwell": branch, "prony_g": 0.4, "prony_tau_s": 1.0}, "this key or prony_g, not both"),
        ({"maxwell": branch, "material": "griffiths2024:cortex"}, "is not viscoelastic itself"),
        ({"maxwell": "Gent"}, "a table of a law"),
        ({"maxwell": {"name": "Fibres", "eta_Pa_s": 1.0}}, "maxwell is Fibres; wanted: an isotropic law"),
    ):
        REGISTRY["Fibres"] = LawEntry(lambda: fibres, ())
        with pytest.raises(InputError, match=said):
            Scene.from_dict(data | {"tissue": [data["tissue"][0] | {"maxwell": None} | more]})
        del REGISTRY["Fibres"]


def test_a_law_of_ones_own_takes_a_class_and_a_line(own, capsys):
    law = LopezPamies(900.0, 1.7)
    stretches = np.linspace(0.9, 1.2, 7)
    stress = lab.stress(law, "uniaxial", stretches)
    # P = 2 W'(I₁) (λ - λ⁻²), W' = 3^(1-a)/2 μ I₁^(a-1)
    first = stretches**2 + 2 / stretches
    assert stress == pytest.approx(3**-0.7 * 900.0 * first**0.7 * (stretches - stretches**-2), rel=1e-9)
    scene = bar(own, 1.1)
    found = solve(
        ModelHierarchy(scene), cheapest(axes_of(scene)) | {"space": "solid", "strain": "finite", "pressure": "unknown"}
    )
    assert found.answers[0] == pytest.approx(float(lab.stress(law, "uniaxial", 1.1)) * 6e-4, rel=1e-3)
    assert scene.tissues[0].initial_modulus == pytest.approx(900.0, rel=1e-6)
    assert main(["materials", "--laws"]) == 0
    said = capsys.readouterr().out
    assert "LopezPamies" in said and "mu_Pa, a " in said and len(said.splitlines()) == len(REGISTRY) + 1
