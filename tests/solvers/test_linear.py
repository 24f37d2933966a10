"""Every solver against another one; what is no matrix to solve with is said by name."""

import ngsolve as ngs
import numpy as np
import pytest
from linear_elasticity import MU, elastic, gravity
from ngsolve.meshes import MakeStructured2DMesh

from ngbrain.errors import InputError, MissingExtra
from ngbrain.mesh import block
from ngbrain.solvers import direct, krylov
from ngbrain.solvers.linear import DirectSolver, ReusedFactorSolver, choose, prepare, reuse_factor
from ngbrain.solvers.multigrid import Patches

SIDE = 0.02


@pytest.fixture(scope="module")
def cube():
    return block((SIDE,) * 3, 0.008)


@pytest.fixture(scope="module")
def square():
    return MakeStructured2DMesh(quads=False, nx=5, ny=5, mapping=lambda x, y: (SIDE * x, SIDE * y))


def available(name):
    try:
        direct.require_package(name)
    except MissingExtra as missing:
        pytest.skip(str(missing))
    return name


def solution(name, form):
    make = prepare(name, form, MU)
    form.Assemble()
    solve = make()
    return solve(gravity(form)), solve


def parts(form, x):
    """Displacements, and pressures if there are any."""
    n = form.space.ndof if form.space.type == "VectorH1" else form.space.components[0].ndof
    return [part for part in (x[:n], x[n:]) if len(part)]


def agrees(form, name, truth):
    x, solve = solution(name, form)
    free = np.fromiter(form.space.FreeDofs(), bool, form.space.ndof)
    assert np.all(x[~free] == 0) and solve.iterations > 0
    for ours, wanted in zip(parts(form, x), parts(form, truth), strict=True):
        assert np.linalg.norm(ours - wanted) <= 1e-6 * np.linalg.norm(wanted)


KINDS = {"displacement": 50, "continuous pressure": 1e4, "discontinuous pressure": 100}
ITERATIVE = [
    ("cg-bddc", "displacement", False),
    ("cg-bddc", "displacement", True),
    ("cg-bddc", "discontinuous pressure", True),
    ("cg-amg", "displacement", False),
    ("cg-amg", "displacement", True),
    ("cg-amg", "discontinuous pressure", True),
    ("minres-bddc", "continuous pressure", False),
    ("minres-bddc", "continuous pressure", True),
    ("minres-amg", "continuous pressure", False),
    ("minres-amg", "continuous pressure", True),
]


@pytest.mark.parametrize("condense", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["umfpack", "pardiso", "mumps", "cudss"])
def test_factors_agree(name, kind, condense, cube):
    truth, _ = solution("sparsecholesky", elastic(kind, cube, KINDS[kind]))
    agrees(elastic(kind, cube, KINDS[kind], condense=condense), available(name), truth)


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("kind", KINDS)
def test_condensation_changes_nothing(kind, order, cube, square):
    for mesh, fixed in ((square, "left|bottom"), (cube, "bottom")):
        truth, _ = solution("umfpack", elastic(kind, mesh, 100, order, fixed=fixed))
        agrees(elastic(kind, mesh, 100, order, condense=True, fixed=fixed), "sparsecholesky", truth)


@pytest.mark.parametrize(("name", "kind", "condense"), ITERATIVE)
def test_iterations_end_at_the_solution_of_a_factor(name, kind, condense, cube, square):
    for mesh, order, fixed in ((cube, 2, "bottom|top"), (square, 3, "left"), (square, 4, "left|right")):
        truth, _ = solution("umfpack", elastic(kind, mesh, KINDS[kind], order, fixed=fixed))
        agrees(elastic(kind, mesh, KINDS[kind], order, condense, fixed), name, truth)


@pytest.mark.parametrize("name", ["cg-amg", "cg-bddc"])
def test_first_order_and_sliding_sides(name, cube):
    for order in (1, 2):
        form = ngs.BilinearForm(
            ngs.VectorH1(cube, order=order, dirichletx="left", dirichlety="front", dirichletz="bottom")
        )
        u, v = form.space.TnT()
        form += 2 * MU * ngs.InnerProduct(ngs.Sym(ngs.Grad(u)), ngs.Sym(ngs.Grad(v))) * ngs.dx
        truth, _ = solution("sparsecholesky", form)
        again = ngs.BilinearForm(form.space, symmetric=True)
        again += 2 * MU * ngs.InnerProduct(ngs.Sym(ngs.Grad(u)), ngs.Sym(ngs.Grad(v))) * ngs.dx
        agrees(again, name, truth)


def test_rigid_motions_strain_nothing(cube, square):
    for mesh in (cube, square):
        form = elastic("displacement", mesh, 50, fixed="")
        form.Assemble()
        patches = Patches(form.space, np.ones(form.space.ndof, bool))
        assert np.linalg.matrix_rank(patches.rigid) == {2: 3, 3: 6}[mesh.dim]
        vector = form.mat.CreateRowVector()
        for motion in patches.rigid.T:
            vector[:] = 0
            vector.FV().NumPy()[patches.vertices] = motion
            assert (form.mat * vector).Evaluate().Norm() < 1e-12 * vector.Norm() * form.mat.AsVector().Norm()


def test_multigrid_takes_as_many_iterations_on_a_finer_mesh():
    found = [solution("cg-amg", elastic("displacement", block((SIDE,) * 3, h), 50))[1].iterations for h in (6e-3, 3e-3)]
    assert max(found) <= 28 and found[1] <= found[0] + 6


@pytest.mark.parametrize("condense", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", direct.NAMES)
def test_a_body_that_nothing_holds_has_no_factor(name, kind, condense, cube):
    form = elastic(kind, cube, 50, condense=condense, fixed="")
    make = prepare(available(name), form)
    form.Assemble()
    with pytest.raises(FloatingPointError, match=r"the tangent cannot be factorised: "):
        make()


def test_not_a_number_has_no_factor(cube):
    form = elastic("displacement", cube, float("nan"))
    make = prepare("umfpack", form)
    form.Assemble()
    with pytest.raises(FloatingPointError, match=r"the tangent cannot be factorised: umfpack"):
        make()


@pytest.mark.parametrize(
    ("name", "kind", "wanted"),
    [
        ("cholesky", "displacement", "did you mean 'sparsecholesky'"),
        ("jacobi", "displacement", "one of cg-amg, cg-bddc, "),
        ("cg-amg", "continuous pressure", "the pressure is not condensed"),
        ("cg-bddc", "discontinuous pressure", "the pressure is not condensed"),
        ("minres-amg", "displacement", "there is no pressure"),
    ],
)
def test_a_name_that_is_not_for_the_form(name, kind, wanted, square):
    with pytest.raises(InputError, match=rf"solver is '{name}'; wanted: .*{wanted}"):
        prepare(name, elastic(kind, square, 50, fixed="left"))


@pytest.mark.parametrize(("name", "package"), [("mumps", "mumps"), ("pardiso", "mkl")])
def test_a_package_that_is_not_there(name, package, square, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mumps", None)
    monkeypatch.setattr("importlib.metadata.version", _no_package)
    with pytest.raises(MissingExtra, match=rf'{package} is not installed; .* "ngbrain\[{name}\]"'):
        prepare(name, elastic("displacement", square, 50, fixed="left"))


def _no_package(name):
    import importlib.metadata

    raise importlib.metadata.PackageNotFoundError(name)


@pytest.mark.parametrize(("name", "kind"), [("cg-amg", "displacement"), ("minres-bddc", "continuous pressure")])
def test_an_iteration_that_does_not_end_says_so(name, kind, square):
    form = elastic(kind, square, 1e4, fixed="left|right")
    _, solve = solution(name, form)
    solve.max_iter = 5
    with pytest.raises(
        FloatingPointError, match=rf"{name}: no convergence in 5 iterations \(residual \S+ of its start"
    ):
        solve(gravity(form))


def test_cg_refuses_what_is_not_definite():
    diagonal = np.array([1.0, -2.0, 3.0])
    with pytest.raises(FloatingPointError, match="the matrix is not positive definite"):
        krylov.cg(lambda x: diagonal * x, lambda r: r, np.ones(3), 1e-8, 10)
    with pytest.raises(FloatingPointError, match="the preconditioner is not positive definite"):
        krylov.minres(lambda x: diagonal * x, lambda r: diagonal * r, np.array([1.0, 2.0, 0.1]), 1e-8, 10)
    x, iterations = krylov.minres(lambda x: diagonal * x, lambda r: r, np.ones(3), 1e-12, 10)
    assert x == pytest.approx(1 / diagonal, rel=1e-10) and iterations == 3


def test_nothing_comes_of_nothing(square):
    for name in ("umfpack", "cg-amg"):
        form = elastic("displacement", square, 10, fixed="left")
        _, solve = solution(name, form)
        assert np.all(solve(np.zeros(form.space.ndof)) == 0)


def squeezed(kind, condense, mesh):
    """The form of a Neo-Hookean body, and how to set its state to a depth."""
    V = ngs.VectorH1(mesh, order=2, dirichlet="bottom|top")
    space = V * {"continuous pressure": ngs.H1, "discontinuous pressure": ngs.L2}[kind](mesh, order=1)
    (u, p), _ = space.TnT()
    F = ngs.Id(3) + ngs.Grad(u)
    J = ngs.Det(F)
    energy = MU / 2 * (J ** (-2 / 3) * ngs.InnerProduct(F, F) - 3) + p * (J - 1) - p * p / (2e3 * MU)
    form = ngs.BilinearForm(space, symmetric=True, condense=condense)
    form += ngs.Variation(energy * ngs.dx)
    state = ngs.GridFunction(space)

    def assemble(depth):
        z = ngs.z / SIDE
        state.components[0].Set(ngs.CF((depth * ngs.y / SIDE * z, 0, -depth * SIDE * z * z / 2)))
        state.components[1].Set(-depth * MU * (1 + ngs.x / SIDE))
        form.AssembleLinearization(state.vec)

    return form, assemble


@pytest.mark.parametrize("condense", [False, True])
@pytest.mark.parametrize("kind", ["continuous pressure", "discontinuous pressure"])
def test_an_older_factor_solves_with_the_new_matrix_if_that_is_near(kind, condense, cube):
    form, assemble = squeezed(kind, condense, cube)
    make = prepare("umfpack", form)
    assemble(0.0)
    kept, r = make(), gravity(form)
    assemble(0.002)
    wanted, old = make()(r), kept(r)
    solve = reuse_factor(form, kept, r, 1e-8, 80)
    assert solve is not None and 3 < solve.iterations <= 80
    for ours, stale, truth in zip(parts(form, solve(r)), parts(form, old), parts(form, wanted), strict=True):
        assert np.linalg.norm(ours - truth) <= 1e-5 * np.linalg.norm(truth) < 1e-3 * np.linalg.norm(stale - truth)
    other = np.roll(r, 3) * (r != 0)
    assert np.linalg.norm(solve(other) - make()(other)) <= 1e-5 * np.linalg.norm(make()(other))
    assemble(0.3)
    assert reuse_factor(form, kept, r) is None


def test_only_a_factor_is_reused(cube):
    form = elastic("displacement", cube, 50)
    _, kept = solution("cg-amg", form)
    assert not isinstance(kept, DirectSolver) and reuse_factor(form, kept, gravity(form)) is None


@pytest.mark.parametrize(
    ("kind", "n", "ratio", "more", "name"),
    [
        ("displacement", 50_000, 50, {}, "sparsecholesky"),
        ("displacement", 200_000, 50, {}, "cg-amg"),
        ("displacement", 200_000, 50, {"order": 4}, "cg-bddc"),
        ("displacement", 200_000, 1e4, {}, "sparsecholesky"),
        ("displacement", 1_000_000, 1e4, {}, "cg-amg"),
        ("displacement", 1_000_000, 1e6, {}, "sparsecholesky"),
        ("displacement", 400_000, 50, {"dim": 2}, "sparsecholesky"),
        ("continuous pressure", 150_000, 1e4, {}, "sparsecholesky"),
        ("continuous pressure", 1_000_000, float("inf"), {}, "minres-amg"),
        ("discontinuous pressure", 1_000_000, 100, {}, "cg-amg"),
        ("discontinuous pressure", 1_000_000, float("inf"), {}, "sparsecholesky"),
        ("continuous pressure", 1_000_000, 1e4, {"symmetric": False}, "umfpack"),
    ],
)
def test_the_choice_says_why(kind, n, ratio, more, name):
    choice = choose(kind, n, ratio, **more)
    assert choice.name == name and choice.why and "\n" not in choice.why


def test_iterations_that_are_foretold():
    assert "about 36 iterations" in choose("displacement", 1_000_000, 4.0, order=4).why
    assert "about 21 iterations" in choose("displacement", 1_000_000, 25.0).why


@pytest.mark.parametrize("kind", ["continuous pressure", "discontinuous pressure"])
def test_fields_of_an_older_factors_solution_weigh_alike(kind, cube):
    form, assemble = squeezed(kind, True, cube)
    make = prepare("umfpack", form)
    assemble(0.0)
    kept, r = make(), gravity(form)
    assemble(0.002)
    solve, seen = reuse_factor(form, kept, r, 1e-8, 80), []
    again = ReusedFactorSolver(solve.condensed, lambda b: seen.append(solve.old(b)) or seen[-1], 1e-8, 80)
    again(r)
    held = [field for field in solve.condensed.fields if not solve.condensed.free[field].any()]  # condensed out
    assert len(held) < len(solve.condensed.fields)
    for field in solve.condensed.fields:
        size = np.linalg.norm((again._scale * seen[0] * solve.condensed.free)[field])
        assert size == pytest.approx(0 if field in held else 1)
