"""Loaded bodies of any tissue of the catalogue: bars against the laboratory's points of tissue, and against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from ngbrain import ladder
from ngbrain.image.read.nifti import write_nifti
from ngbrain.image.read.volume import Volume
from ngbrain.ladder.axes import axes_of, cheapest
from ngbrain.ladder.models.hierarchy import ModelHierarchy, _times, solve
from ngbrain.ladder.models.waves import complex_modulus
from ngbrain.materials import CATALOGUE, constants, fourier, lab
from ngbrain.scene import DisplacementBC, Geometry, Gravity, MeshSize, Quantity, Scene, Time, Tissue

HEIGHT, AREA = 0.04, 0.02 * 0.03
BAR = Geometry(kind="block", size=(0.02, 0.03, HEIGHT))
FREE = (
    DisplacementBC(boundary="bottom", components="z"),
    DisplacementBC(boundary="left", components="x"),
    DisplacementBC(boundary="front", components="y"),
)
FORCE = Quantity(name="force", boundary="top", tolerance=0.5)
KEPT = 0.4999


def stretched(name, stretch, **more):
    """A bar whose sides are free, to a stretch along its height."""
    pulled = DisplacementBC(boundary="top", value=(0, 0, (stretch - 1) * HEIGHT), components="z")
    parts = {
        "tissues": (Tissue(material=name, poissons_ratio=KEPT),),
        "displacement_bcs": (*FREE, pulled),
        "quantities": (FORCE,),
    }
    return Scene(mesh=MeshSize(largest=HEIGHT), geometry=BAR, **(parts | more))


def model_of(scene, **levels):
    return {**cheapest(axes_of(scene)), "space": "solid", **levels}


@pytest.mark.parametrize(
    ("name", "stretch"),
    [
        ("budday2017:cortex", 0.92),
        ("budday2017:corona_radiata:neohooke:tension", 1.08),
        ("budday2017:cortex:demiray:compression", 0.92),
        ("budday2017:cortex:gent:compression", 0.92),
        ("laksari2012:brain", 0.8),
        ("franceschini2006:brain", 1.08),
    ],
)
def test_a_bar_has_the_stress_of_its_law(name, stretch):
    scene = stretched(name, stretch)
    found = solve(ModelHierarchy(scene), model_of(scene, strain="finite", pressure="unknown")).answers[0]
    wanted = float(lab.stress(constants(name).law(), "uniaxial", stretch)) * AREA
    print(name, found / wanted - 1)
    assert found == pytest.approx(wanted, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "level"),
    [("miller1997:brain", "prony"), ("miller2002:brain", "prony"), ("griffiths2024:cortex", "flowing")],
)
def test_a_bar_relaxes_as_its_law(name, level):
    asks = (replace(FORCE, when="ramp"), FORCE)
    scene = stretched(name, 0.93, time=Time(ramp=2.0, end=20.0), quantities=asks)
    bench, model = ModelHierarchy(scene), model_of(scene, strain="finite", pressure="unknown", time=level)
    found = solve(bench, model).answers
    times = _times(bench, model, 20.0)
    stress = lab.history(constants(name).law(), "uniaxial", times, 1 - 0.07 * np.minimum(times / 2.0, 1.0))
    wanted = stress[[np.argmin(np.abs(times - 2.0)), -1]] * AREA
    print(name, found / wanted - 1)
    assert found == pytest.approx(wanted, rel=1e-3) and abs(found[1]) < 0.8 * abs(found[0])


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_bar_of_anything_has_its_small_strain_force(name):
    """E ε A with Young's modulus E of μ₀ and of the bulk modulus that is the source's or assumed."""
    scene = stretched(name, 0.999, tissues=(Tissue(material=name),))
    found = solve(ModelHierarchy(scene), model_of(scene)).answers[0]
    entry = constants(name)
    nu, mu = entry.poisson, entry.initial_modulus
    K = entry.bulk or (2 * mu * (1 + nu) / (3 * (1 - 2 * nu)) if nu else 1000 * mu)
    assert scene.tissues[0].bulk == pytest.approx(K)
    assert found == pytest.approx(-1e-3 * 9 * K * mu / (3 * K + mu) * AREA, rel=1e-4)


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_modulus_of_waves_is_that_of_the_law(name):
    omega, stuff = 2 * np.pi * np.array([0.1, 50.0]), Tissue(material=name)
    wanted = fourier(constants(name).law())(omega) * np.ones(2)
    assert [complex_modulus(stuff, float(w), True) for w in omega] == pytest.approx(wanted, rel=1e-6)


def test_fibres_of_a_map_are_those_of_one_direction(tmp_path):
    """Along a bar and across it; a map has no section."""
    pytest.importorskip("nibabel")
    place = np.diag([2e-3, 2e-3, 2e-3, 1.0])
    place[:3, 3] = -0.02, -0.02, -0.005
    found = {}
    for name, along in (("along", (0, 0, 1)), ("across", (1, 0, 0))):
        write_nifti(tmp_path / f"{name}.nii.gz", Volume(np.tile(np.array(along, float), (21, 21, 26, 1)), place))
        a_map = {"fibre_map": str(tmp_path / f"{name}.nii.gz"), "fibre_map_convention": "nifti"}
        for kind, way in (("one", {"fibre": along}), ("map", a_map)):
            tissue = Tissue(material="budday2017:cortex", poissons_ratio=KEPT, fibre_stiffness=3e3, **way)
            scene = stretched("budday2017:cortex", 1.08, tissues=(tissue,))
            model = model_of(scene, strain="finite", pressure="unknown", fibres="all")
            found[name, kind] = solve(ModelHierarchy(scene), model).answers[0]
            assert "space" not in axes_of(scene) or kind == "one" or axes_of(scene)["space"].levels == ("solid",)
    # k₁ E exp(k₂ E²) 2λ of nominal stress beside the law's, E = λ² - 1
    E = 1.08**2 - 1
    wanted = (
        float(lab.stress(constants("budday2017:cortex").law(), "uniaxial", 1.08)) + 3e3 * E * np.exp(E * E) * 2 * 1.08
    )
    assert found["along", "one"] == pytest.approx(wanted * AREA, rel=1e-3)
    for name in ("along", "across"):
        assert found[name, "map"] == pytest.approx(found[name, "one"], rel=1e-9)
    assert found["across", "one"] < 0.5 * found["along", "one"]


def test_hereditary_tissue_has_no_richer_memory():
    times = {name: axes_of(stretched(name, 0.9)).get("time") for name in ("miller2002:brain", "griffiths2024:cortex")}
    assert times["miller2002:brain"].levels == ("instantaneous", "relaxed", "prony")
    assert times["griffiths2024:cortex"].levels[-1] == "flowing"
    assert "time" not in axes_of(stretched("budday2017:cortex", 0.9))


def test_what_is_assumed_is_said():
    own, named = Tissue(mu=1000.0), Tissue(material="pearcy2022:dura", region="dura")
    scene = stretched(
        "bennion2022:brain", 0.999, tissues=(own, named, Tissue(region="x", material="bennion2022:brain"))
    )
    said = ladder.solve(scene, model=model_of(scene))["warnings"]
    assert said == [
        "tissue#1 (.*): bulk_to_shear_ratio is not given: 1000 is assumed, nearly incompressible",
        "tissue#2 (dura): pearcy2022:dura (human cranial dura mater): a linear law for small strain, used as Neo-Hookean; "
        "measured in tension alone",
        "tissue#2 (dura): bulk_to_shear_ratio is not given: 1000 is assumed, nearly incompressible",
        "tissue#3 (x): bulk_to_shear_ratio is not given: 220.9 is used, of the source's bulk modulus",
    ]
    heavy = stretched(
        "bennion2022:brain",
        0.999,
        tissues=(Tissue(mu=1e3, poissons_ratio=0.4),),
        gravity=Gravity(acceleration=(0, 0, 9.81)),
    )
    (line,) = ladder.solve(heavy, model=model_of(heavy))["warnings"]
    assert line == "tissue#1 (.*): density_kg_m3 is not given: 1040 is assumed"
    shaken = replace(heavy, gravity=None, time=Time(frequency=50.0), tissues=(replace(heavy.tissues[0], density=1e3),))
    (line,) = ladder.solve(shaken, model=model_of(shaken))["warnings"]
    assert line == "tissue#1 (.*): it is neither viscoelastic nor has a loss tangent: waves in it are not attenuated"
