"""What a notebook shows of scenes, data, images, laws, meshes and bodies: one line as text, a table with a thumbnail."""

import warnings
from itertools import permutations, product

import ngsolve as ngs
import numpy as np
import pytest

import ngbrain as nb
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.materials import Branch, Compressible, Gent, Maxwell, NeoHooke, Prony, Shearing, constants
from ngbrain.mesh import block
from ngbrain.mesh.head_mesh import middle_slice
from ngbrain.mesh.tet_mesh import named_elements
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Tissue

pytest.importorskip("matplotlib")


def waves(folder):
    nb.datasets.write("waves_plane", folder)
    return nb.read_waves(next(folder.rglob("*.npz")))


def labels(_):
    far = np.linalg.norm(np.indices((12, 12, 12)) - 6, axis=0)
    numbers = (far < 5).astype(np.uint8) + (far < 3)
    return LabelMap(Volume(numbers, np.diag([2e-3, 2e-3, 2e-3, 1.0])), {1: "grey", 2: "white"})


def body(_):
    return nb.Problem(block(), {".*": nb.Material(NeoHooke(1e3), bulk=1e6)}, {"bottom": 0, "top": (0, 0, -1e-3)})


def plate(_):
    mesh = ngs.Mesh(ngs.unit_square.GenerateMesh(maxh=0.5))
    return nb.Problem(mesh, {".*": nb.Material(NeoHooke(1e3), bulk=1e4)}, {"bottom": 0})


def loaded(_, **more):
    return Scene(
        title="pressed block",
        geometry=Geometry(kind="block", size=(0.06, 0.06, 0.04)),
        mesh=MeshSize(largest=0.02),
        tissues=[Tissue(mu=1000.0)],
        displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-3))],
        quantities=[Quantity(name="force", boundary="top", tolerance=0.05)],
        **more,
    )


def elements(_):
    corners = np.array(list(product((0, 1), repeat=3)))  # a cube of six tetrahedra around its diagonal
    tets = np.array([np.cumsum([0, *steps]) for steps in permutations((1, 2, 4))])
    return named_elements(0.01 * corners, tets, np.arange(6) % 2, ("grey", "white"))


SHOWN = {
    "scene of a head": (lambda _: Scene.shipped("idealised"), "idealised", False),
    "scene of a body": (loaded, "pressed block", True),
    "waves": (waves, "60 Hz", True),
    "image": (lambda folder: labels(folder).volume, "12 × 12 × 12 voxels; 2 × 2 × 2 mm", True),
    "labels": (labels, "white", True),
    "body": (body, "NeoHooke", True),
    "body in the plane": (plate, "in 2-D", False),
    "mesh": (elements, "6 tetrahedra, 8 points", True),
    "law": (lambda _: Gent(900.0, 0.5), "Gent", True),
    "sum of laws": (lambda _: NeoHooke(1e3) + Compressible(5e4), "Compressible", True),
    "viscoelastic law": (lambda _: Prony(Gent(842.0, 0.5), [0.1] * 4, [0.5, 5.0, 50.0, 500.0]), "Gent", True),
    "Maxwell branch": (lambda _: Maxwell(NeoHooke(970.0), eta=2190.0), "970", True),
    "hereditary branch": (lambda _: Branch(NeoHooke(970.0), tau=2.3), "2.3", True),
    "law of a field": (lambda _: NeoHooke(1e3 + ngs.x), "NeoHooke", False),
    "law of waves": (lambda _: Shearing(1e3 + 200j), "200j", False),
    "published material": (lambda _: constants("budday2017:cortex"), "budday2017:cortex", True),
    "material of a region": (lambda _: nb.Material(NeoHooke(1e3), bulk=1e6), "NeoHooke", True),
}


@pytest.mark.parametrize("name", SHOWN)
def test_one_line_and_a_card(name, tmp_path):
    make, said, seen = SHOWN[name]
    made = make(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text, card = repr(made), made._repr_html_()
    assert said in text and "\n" not in text and len(text) <= 200
    assert card.startswith(f"<table><caption>{type(made).__name__}") and ("<img" in card) == seen


def test_a_law_tells_its_energy_parameters_and_units():
    rows = Gent(900.0, 0.5).summary()
    assert rows["energy"].startswith("W = -μ J_m/2 ln") and rows["parameters"] == "μ = 900 Pa, J_m = 0.5"
    assert rows["shear modulus"] == "0.9 kPa"
    relaxing = Prony(NeoHooke(800.0), [0.75], [2.0]).summary()
    assert relaxing["parameters"] == "instantaneous: μ = 800 Pa; branch 1: g = 0.75, τ = 2 s"
    assert relaxing["shear modulus"] == "0.8 kPa initially; 0.2 kPa in the long term"
    assert NeoHooke(1e3 + ngs.x).summary()["parameters"] == "μ = a field"
    assert NeoHooke(ngs.Parameter(700.0)).summary()["parameters"] == "μ = 700 Pa"


def test_the_plot_of_a_law_is_its_stress():
    """Neo-Hooke in tension and shear: μ (λ - λ⁻²) and μ γ, in kPa."""
    uniaxial, shear = NeoHooke(1000.0).plot().axes
    stretch, stress = uniaxial.lines[0].get_data()
    assert stress == pytest.approx(stretch - stretch**-2, abs=1e-9)
    gamma, stress = shear.lines[0].get_data()
    assert stress == pytest.approx(gamma, abs=1e-9)


def test_a_published_law_is_drawn_over_its_data():
    entry = constants("budday2017:cortex:ogden:compression")
    for shown in (entry, entry.law()):
        assert shown.plot().axes[0].lines[0].get_xdata()[[0, -1]] == pytest.approx(entry.stretch)


def test_a_card_says_why_it_has_no_picture():
    assert "no picture: law is NeoHooke with a parameter that varies in space" in NeoHooke(1e3 + ngs.x)._repr_html_()


def test_the_picture_of_a_scene_is_that_of_its_preview():
    page = loaded(None).plot()
    assert [axes.get_title(loc="left") for axes in page.axes] == ["", "x = 0.0 mm", "y = 0.0 mm", "z = 20.0 mm"]
    assert [text.get_text() for text in page.legends[0].get_texts()] == ["fixed", "moved", "tissue"]


def test_the_picture_of_raw_elements_is_that_of_the_mesh():
    made = elements(None)
    assert len(made.plot().axes) == len(middle_slice(made).axes)


def test_a_saved_scene_is_read_anywhere(tmp_path, monkeypatch):
    """Relative paths are made absolute, so that the file means the same from every folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other").mkdir()
    scene = Scene(
        geometry=Geometry(kind="mesh", file="mesh.vol", unit="mm"),
        tissues=[Tissue(mu=1000.0)],
        displacement_bcs=[DisplacementBC(boundary="bottom")],
        quantities=[Quantity(name="force", boundary="bottom")],
    )
    file = scene.save(tmp_path / "other" / "scene.toml")
    assert Scene.from_toml(file).geometry.file == str(tmp_path / "mesh.vol")
    assert Scene.from_toml(loaded(None).save(tmp_path / "body.toml")) == loaded(None)


def test_a_card_has_no_thumbnail_without_matplotlib(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    assert "<img" not in labels(None)._repr_html_() and "<table>" in labels(None)._repr_html_()
