"""Large strain in one load step. Naive: NGSolve's own Newton takes whatever step comes and fails at every depth.

Ours: steps that cut themselves, and no state with det F ≤ 0 at any quadrature point. A bonded block in plane strain pressed
by 35 % in one requested step: 3 cuts at most, 41 iterations at most, the energy of a path of ten. A bonded cube pressed by
a fifth in one step, hexahedra and tetrahedra, on meshes graded towards its edges too.
"""

import ngsolve as ngs
import numpy as np
import pytest
from finite_strain import eighth_of_a_shell
from ngsolve.meshes import MakeStructured2DMesh
from ngsolve.solvers import Newton as NgsolveNewton
from statics import bonded, cube, square, tight

from ngbrain.errors import ConvergenceError, InputError
from ngbrain.forward.common.loads import CavityPressure
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import NeoHooke, UnsplitNeoHooke, squared_log

ENERGIES = {0.1: 0.029547, 0.2: 0.131091, 0.3: 0.324616, 0.35: 0.463975}
OTHER_LAWS = {
    "of the shape alone": (Material(NeoHooke(1.0), 1e3), 0.469366),
    "logarithm of the volume": (Material(UnsplitNeoHooke(1.0), 1e3, change=squared_log), 0.473799),
}


def pressed(depth, material=None, mesh=None):
    material = material or Material(UnsplitNeoHooke(1.0), 1e3)
    return Problem(mesh or square(8), {".*": material}, {"bottom": 0, "top": (0, -depth)}, element="P2/P1")


@pytest.mark.parametrize("depth", ENERGIES)
def test_naive_newton_fails_in_one_step(depth):
    mesh = square(8)
    fes = ngs.VectorH1(mesh, order=2, dirichlet="bottom|top") * ngs.H1(mesh, order=1)
    (u, p), state = fes.TrialFunction(), ngs.GridFunction(fes)
    F = ngs.Id(2) + ngs.Grad(u)
    J = ngs.Det(F)
    form = ngs.BilinearForm(fes, symmetric=True)
    energy = 0.5 * (ngs.InnerProduct(F, F) - 2 - 2 * ngs.log(J)) + p * (J - 1) - p * p / 2e3
    form += ngs.Variation(energy.Compile() * ngs.dx)
    state.components[0].Set((0, -depth), definedon=mesh.Boundaries("top"))
    try:
        failed, steps = NgsolveNewton(form, state, maxit=25, inverse="umfpack", printing=False)
    except Exception:
        return  # it died in the factorisation: a failure too
    print("naive", depth, failed, steps, form.Energy(state.vec))
    assert failed or not np.isfinite(form.Energy(state.vec))


@pytest.mark.parametrize("depth", ENERGIES)
def test_ours_gets_there_in_one_requested_step(depth):
    body = pressed(depth)
    record = LoadPath(body).solve(newton=tight())
    print(depth, body.energy, "cuts", record.cuts, "iterations", record.tried, "det F", record.min_det_F)
    assert body.energy == pytest.approx(ENERGIES[depth], abs=1e-6)
    assert len(record.cuts) <= 3 and record.tried <= 41 and record.min_det_F > 0.1


@pytest.mark.parametrize(("material", "energy"), OTHER_LAWS.values(), ids=OTHER_LAWS)
def test_other_laws_of_the_same_moduli(material, energy):
    body = pressed(0.35, material)
    record = LoadPath(body).solve(newton=tight())
    print(body.energy, record.cuts, record.tried)
    assert body.energy == pytest.approx(energy, abs=1e-6) and len(record.cuts) <= 3


def test_the_path_does_not_matter():
    found = []
    for steps in (1, 10):
        body = pressed(0.35)
        record = LoadPath(body).solve(steps, tight())
        found.append(body.energy)
        print(steps, record.cuts, record.tried)
    assert found[1] == pytest.approx(found[0], rel=1e-8)


CUBES = [(4, 0.0), (6, 0.0), (4, 1.5), (4, 2.0), (6, 1.5), (6, 2.0)]
FINE = [(8, 0.0), (12, 0.0), (8, 1.5), (8, 2.0)]


def check_cube(n, steepness, hexes):
    body = bonded(cube(n, hexes, steepness))
    record = LoadPath(body).solve()
    print(n, steepness, "hexahedra" if hexes else "tetrahedra", body.force("top")[2], end=" ")
    print("cuts", record.cuts, "iterations", record.tried, "det F", record.min_det_F)
    assert record.converged and record.min_det_F > 0 and np.isfinite(body.energy)
    assert body.force("top")[2] == pytest.approx(-9.2, rel=0.06)  # towards -8.98 as h^0.6


@pytest.mark.parametrize("hexes", [False, True], ids=["tetrahedra", "hexahedra"])
@pytest.mark.parametrize(("n", "steepness"), CUBES)
def test_a_bonded_cube_in_one_step(n, steepness, hexes):
    check_cube(n, steepness, hexes)


@pytest.mark.slow
@pytest.mark.parametrize("hexes", [False, True], ids=["tetrahedra", "hexahedra"])
@pytest.mark.parametrize(("n", "steepness"), FINE)
def test_a_bonded_cube_in_one_step_on_finer_meshes(n, steepness, hexes):
    check_cube(n, steepness, hexes)


def test_a_mesh_with_an_inverted_element_is_refused_by_its_number():
    def folded(x, y):
        return (x + 0.3, y + 0.3) if (x, y) == (0.5, 0.5) else (x, y)

    mesh = MakeStructured2DMesh(quads=False, nx=4, ny=4, mapping=folded)
    with pytest.raises(InputError, match=r"mesh is inverted at element (\d+) of region 'dom'") as error:
        pressed(0.1, mesh=mesh)
    number = int(str(error.value).split("element ")[1].split()[0])
    points = np.array([mesh[v].point for v in mesh[ngs.ElementId(ngs.VOL, number)].vertices])
    jacobian = ngs.Integrate(ngs.Det(ngs.specialcf.JacobianMatrix(2)), mesh, element_wise=True).NumPy()
    assert np.any(np.all(np.isclose(points, 0.8), axis=1)) and jacobian[number] * np.sum(jacobian) < 0


def test_beyond_a_limit_point_there_is_an_error_with_the_last_equilibrium():
    # A thick sphere bears P/μ = 0.8164 at most.
    planes = {"x": (0, None, None), "y": (None, 0, None), "z": (None, None, 0)}
    sphere = {".*": Material(NeoHooke(1.0), 1e4)}
    body = Problem(eighth_of_a_shell(0, 3), sphere, planes, [CavityPressure("cavity", 1.0)], element="P3/P2")
    with pytest.raises(ConvergenceError, match=r"load factor .* was reached") as error:
        LoadPath(body).solve()
    record = error.value.result
    print(error.value, record.cuts, record.min_det_F)
    assert not record.converged and record.cuts and record.factor == pytest.approx(0.8164, abs=0.01)
    assert body.factor.Get() == pytest.approx(record.factor, rel=1e-12)
    assert body.min_det(body.x) > 0.5 and np.isfinite(body.energy)
    residual, size = body.residual(body.x)
    assert np.linalg.norm(residual) < 2e-3 * size
