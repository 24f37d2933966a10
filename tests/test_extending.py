"""Each recipe of CONTRIBUTING from outside the package: a misfit, a regulariser, a mesh route, a tool and an axis of the ladder.

A law is added in `tests/materials/test_registry.py`, an observable in `tests/ladder/models/test_questions.py` and, as data of an
inversion, in `tests/forward/observables/test_observables.py`.
"""

from dataclasses import dataclass, replace

import cubes as cubes_module
import ngsolve as ngs
import numpy as np
import pytest
from cubes import cubes

import ngbrain as nb
from ngbrain.adjoint.check import taylor
from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.image.labelling import Segmentation
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.nifti import write_nifti
from ngbrain.image.read.volume import Scan, Volume
from ngbrain.image.segment.tissue_classes import CSF, GREY, VENTRICLE, WHITE
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.ladder.axes import Axis
from ngbrain.ladder.levels import PresenceLevel
from ngbrain.ladder.model_search import search_along
from ngbrain.ladder.models import geometry as head_meshes
from ngbrain.ladder.models.hierarchy import ModelHierarchy, Solution
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.materials import NeoHooke
from ngbrain.mesh import Cleft, Sizes, block
from ngbrain.mesh.routes.registry import ROUTES, Route, mesh_labels, subtract_cleft
from ngbrain.scene import CleftSpec, DisplacementBC, Geometry, MeshSize, Quantity, Scene, Tissue, Tool
from ngbrain.surgery import head_models
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.tools import RigidTool


class Cauchy(LeastSquares):
    """Φ = Σ ln(1 + |r|²/2): one gross error weighs next to nothing."""

    def value(self, data):
        return float(np.sum(np.log1p(np.abs(self.residual(data)) ** 2 / 2)))

    def gradient(self, data):
        return self.residual(data) / (1 + np.abs(self.residual(data)) ** 2 / 2) / self.sigma

    def weight(self, data):
        return super().weight(data) / (1 + np.abs(self.residual(data)) ** 2 / 2)


def test_a_misfit_is_a_class_that_invert_takes():
    measured = Phantom.from_name("CV-G", 13).simulate_measurements(0.02)
    rng = np.random.default_rng(0)
    misfit, x, dx = Cauchy(rng.normal(size=9), 1.0), rng.normal(size=9), rng.normal(size=9)
    assert min(taylor(misfit.value, misfit.gradient(x), x, dx)) > 1.9
    found = nb.invert(measured.data(), noise=0.02, misfit=Cauchy, regulariser="smooth")
    assert found.answers["storage"]["relative_l2_error"] < 0.05


def test_a_regulariser_is_a_function_that_invert_takes():
    def stiff_in_x(space, reference):
        return smooth(space, reference)

    found = nb.invert(
        Phantom.from_name("CV-G", 13).simulate_measurements(0.02).data(), noise=0.02, regulariser=stiff_in_x
    )
    assert found.regulariser == "stiff_in_x"


@pytest.fixture
def own_route(monkeypatch):
    own = Route(cubes, 5e-3, 20e-3, "smooth surfaces", (cubes_module,), subtract_cleft(cubes))
    monkeypatch.setitem(ROUTES, "cubes", own)
    return own


VOXEL = 4e-3
CLASSES = {CSF: 38e-3, GREY: 34e-3, WHITE: 26e-3, VENTRICLE: 9e-3}
"""Radius of each tissue's ball (m)."""


@pytest.fixture
def balls(monkeypatch):
    """Balls of tissue, one in the other, in place of the head of a scan."""
    axis = VOXEL * (np.arange(-11, 11) + 0.5)
    away = np.sqrt(sum(x**2 for x in np.meshgrid(axis, axis, axis, indexing="ij")))
    data = np.zeros(away.shape, np.uint8)
    for tissue, radius in CLASSES.items():
        data[away < radius] = tissue
    affine = np.diag([VOXEL] * 3 + [1.0])
    affine[:3, 3] = axis[0]
    scan = Scan(Volume(data.astype(float), affine), affine, data.shape, "balls")
    for module in (head_models, head_meshes):
        monkeypatch.setattr(module, "mni152", lambda: scan)
        monkeypatch.setattr(module, "label_tissues", lambda _: Segmentation(Volume(data, affine), 6.0))
    return data


def test_a_mesh_route_is_one_entry(own_route, tmp_path):
    data = np.zeros((6, 6, 6), np.uint8)
    data[1:5, 1:5, 1:5] = 1
    data[1:5, 1:5, 3:5] = 2
    write_nifti(tmp_path / "labels.nii.gz", Volume(data, np.diag([5e-3, 5e-3, 5e-3, 1.0])))
    names = {1: "grey", 2: "white"}
    made = nb.mesh_head(tmp_path / "labels.nii.gz", tmp_path / "head.vtkhdf", "cubes", labels=names)
    assert made.value == pytest.approx({"grey": 32 * 0.125, "white": 32 * 0.125}) and made["route"] == "cubes"
    assert made["left_out"] == "smooth surfaces"
    with pytest.raises(InputError, match="route is 'cube'; wanted: did you mean 'cubes'"):
        nb.mesh_head(tmp_path / "labels.nii.gz", tmp_path / "head.vtkhdf", "cube", labels=names)


def test_the_cache_keeps_routes_apart(own_route, monkeypatch):
    data, cut = np.ones((2, 2, 2), np.uint8), np.zeros((2, 2, 2), np.float32)
    cut[0] = 1.0
    labels = LabelMap(Volume(data, np.diag([5e-3, 5e-3, 5e-3, 1.0])), {1: "grey"})
    half = replace(own_route, make=lambda labels, size: cubes(replace(labels, cut=cut), size))
    monkeypatch.setitem(ROUTES, "half", half)
    assert [len(mesh_labels(labels, route).elements.tets) for route in ("cubes", "half", "cubes")] == [48, 24, 48]


HEAD = {
    "geometry": Geometry(kind="mni152"),
    "tissues": [Tissue(mu=1000.0, poissons_ratio=0.4)],
}


def test_a_scene_takes_a_mesh_route_of_its_own(own_route, balls):
    place = (0.01, -0.004, 0.012)
    scene = Scene(
        **HEAD,
        mesh=MeshSize(route="cubes"),
        displacement_bcs=[DisplacementBC(boundary="skull", value=("1e-2*y", "0*x", "2e-2*x"))],
        quantities=[Quantity(name="displacement", point=place, direction=(0, 0, 1))],
    )
    assert Scene.from_dict(scene.to_dict()) == scene and scene.to_dict()["mesh"]["route"] == "cubes"
    bench = ModelHierarchy(scene)
    model = {"strain": "linear", "pressure": "none", "order": "1", "mesh": "0"}
    assert bench.solve(model).answers == pytest.approx([2e-2 * place[0]], rel=1e-5)
    mesh = bench.mesh(model)
    assert mesh.ne == 6 * np.count_nonzero(balls)
    volumes = dict(zip(mesh.GetMaterials(), ngs.Integrate(ngs.CF(1), mesh, region_wise=True), strict=True))
    counts = np.bincount(balls.ravel()) * VOXEL**3
    wanted = {"grey": counts[CSF] + counts[GREY], "white": counts[WHITE], "ventricles": counts[VENTRICLE]}
    assert volumes == pytest.approx(wanted)
    out = ngs.CF((ngs.x, ngs.y, ngs.z)) * ngs.specialcf.normal(3)
    wall = mesh.Boundaries("ventricle_wall")
    assert ngs.Integrate(out, mesh, ngs.BND, definedon=wall) == pytest.approx(3 * counts[VENTRICLE])


def test_an_operation_takes_a_mesh_route_of_its_own(own_route, balls, monkeypatch):
    cleft = CleftSpec(
        target=(0, 0, 3 * VOXEL), trajectory=(0, 0, 1), wall_normal=(1, 0, 0), gap=2 * VOXEL, width=4 * VOXEL
    )
    scene = Scene(**HEAD, cleft=cleft, tools=[Tool(thickness=2 * VOXEL)], mesh=MeshSize(route="cubes"))
    model = RetractionModel.from_scene(scene)
    mesh = model.mesh
    assert set(mesh.GetBoundaries()) >= {"skull", "craniotomy", "wall_plus", "wall_minus", "floor", "ventricle_wall"}
    assert set(mesh.GetMaterials()) == {"grey", "white", "ventricles"} == set(model.materials())
    assert model.fixed == "skull" and 6 * np.count_nonzero(balls) > mesh.ne == 6 * (mesh.ne // 6)
    walls = mesh.Boundaries("wall_plus")
    assert ngs.Integrate(ngs.specialcf.normal(3)[0], mesh, ngs.BND, definedon=walls) < 0
    assert ngs.Integrate((ngs.x - VOXEL) ** 2, mesh, ngs.BND, definedon=walls) < 1e-20
    assert "smooth surfaces" in model.head.left_out

    monkeypatch.setitem(ROUTES, "cubes", replace(own_route, open_cleft=None))
    with pytest.raises(InputError, match=r"mesh.route is 'cubes'; wanted: a route that opens a cleft: hull, lattice"):
        replace(scene, title="again")
    with pytest.raises(InputError, match=r"route is 'cubes', which opens no cleft"):
        model.head.open_cleft(model.cleft, 40e-3, Sizes())


def test_what_no_route_meshes_has_none():
    with pytest.raises(InputError, match=r"mesh.route is 'latice'; wanted: did you mean 'lattice'"):
        MeshSize(route="latice")
    with pytest.raises(InputError, match=r"mesh.route is 'lattice'; wanted: this key left out: only a head of labels"):
        replace(Scene.shipped("idealised"), mesh=MeshSize(route="lattice"))


@dataclass(frozen=True)
class Wedge(RigidTool):
    """A plane face that leans by `lean` (a slope) towards the cleft's floor."""

    cleft: Cleft
    width: float
    tip: float
    lean: float = 0.1

    def distance(self, advance):
        across, out = (ngs.CF(tuple(map(float, v))) for v in (self.cleft.across, self.cleft.out))
        target = ngs.CF(tuple(map(float, self.cleft.target)))

        def signed(x):
            way = ngs.InnerProduct(x - target, across) - self.cleft.width / 2 - advance
            return (way - self.lean * ngs.InnerProduct(x - target, out)) / np.hypot(1, self.lean)

        return signed

    def bounds(self, advance):
        half = self.width / 2
        return np.array([-half, -half, self.tip]), np.array([half + advance, half, self.cleft.depth])


def test_a_tool_is_its_signed_distance():
    """A block that a leaning face presses gets the pressure of the wedge's penetration, more where it leans further."""
    side = 0.02
    cleft = Cleft(np.array([side / 2, 0, side + 1e-3]), np.array([0, 1.0, 0]), np.array([0, 0, -1.0]), side, 2e-3, 8e-3)
    tool = Wedge(cleft, 8e-3, 1e-3)
    assert tool.signed_distance(0.0, np.array([[cleft.width / 2, 0, 0]])) == pytest.approx([0.0], abs=1e-12)
    pressed = RigidContact("top", tool.distance(ngs.CF(1e-3)), 1e6, 1e-5)
    body = nb.Problem(
        block((side,) * 3, side / 2), {".*": Material(NeoHooke(1e3), bulk=2e4)}, {"bottom": 0}, contacts=[pressed]
    )
    nb.LoadPath(body).solve()
    force = body.force("bottom")
    assert force[2] > 0.01 and body.min_gap() < 0


class Beam:
    """Deflections of a cantilever by a force at its end: by bending, or with shear."""

    init_arguments = ()

    def __init__(self, slenderness):
        self.slenderness = slenderness

    def solve(self, model, near=None):
        shear = 3.12 / 4 / self.slenderness**2 * 4 / 3 * 1.2  # (1 + ν) h²/(4 κ l²) …, of a narrow section
        answer = 1.0 + (shear if model["shear"] == "all" else 0.0)
        return Solution(np.array([answer]), {}, 1, 1e-3)

    def has_states(self, model):
        return False


@pytest.mark.parametrize(("slenderness", "level"), [(1.0, "all"), (30.0, "none")])
def test_an_axis_is_levels_an_estimator_and_what_they_mean(slenderness, level):
    shear = Axis("shear", tuple(PresenceLevel), ("shear",), ("solve",), (1.0,))
    found = search_along({"shear": shear}, SolutionCache(Beam(slenderness)), np.array([0.05]), lambda _: None)
    assert found.chosen.model["shear"] == level and found.converged
