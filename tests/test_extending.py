"""Each recipe of CONTRIBUTING from outside the package: a misfit, a regulariser, a mesh route, a tool and an axis of the ladder.

A law is added in `tests/materials/test_registry.py`, an observable in `tests/ladder/models/test_questions.py` and, as data of an
inversion, in `tests/forward/observables/test_observables.py`.
"""

import sys
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
import pytest

import ngbrain as nb
from ngbrain.adjoint.check import taylor
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.ladder.axes import Axis
from ngbrain.ladder.levels import PresenceLevel
from ngbrain.ladder.model_search import search_along
from ngbrain.ladder.models.hierarchy import Solution
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.materials import NeoHooke
from ngbrain.mesh import Cleft, block
from ngbrain.mesh.routes.registry import ROUTES, LabelMesh, Route, mesh_labels
from ngbrain.mesh.tet_mesh import named_elements
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


def cubes(labels, size):
    """Six tetrahedra for each voxel of a label: no element is smaller, none follows a surface."""
    at = np.argwhere(labels.volume.data > 0)
    steps = np.array([[i >> k & 1 for k in range(3)] for i in range(8)])
    corners = at[:, None] + steps
    flat, tets = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    kuhn = np.array([[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]])
    tets = tets.reshape(-1, 8)[:, kuhn].reshape(-1, 4)
    affine = labels.volume.affine
    points = (flat - 0.5) @ affine[:3, :3].T + affine[:3, 3]
    volume = np.linalg.det(points[tets[:, 1:]] - points[tets[:, :1]])
    tets[volume > 0] = tets[volume > 0][:, [1, 0, 2, 3]]
    region = np.repeat(labels.volume.data[tuple(at.T)].astype(int) - 1, 6)
    return LabelMesh(named_elements(points, tets, region, labels.regions))


def test_a_mesh_route_is_one_entry(monkeypatch):
    monkeypatch.setitem(ROUTES, "cubes", Route(cubes, 5e-3, 20e-3, "smooth surfaces", (sys.modules[__name__],)))
    data = np.zeros((6, 6, 6), np.uint8)
    data[1:5, 1:5, 1:5] = 1
    data[2:4, 2:4, 2:4] = 2
    labels = LabelMap(Volume(data, np.diag([5e-3, 5e-3, 5e-3, 1.0])), {1: "grey", 2: "white"})
    made = mesh_labels(labels, "cubes")
    assert made.value == pytest.approx({"grey": 56 * 0.125, "white": 8 * 0.125})
    mesh = made.elements.mesh()
    assert set(mesh.GetMaterials()) == {"grey", "white"} and ngs.Integrate(1.0, mesh) == pytest.approx(64 * 0.125e-6)


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
