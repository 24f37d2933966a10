"""Inversion by conjugate gradients on a block with a stiff ball: data of another order and mesh, 2 % noise."""

from functools import cache

import ngsolve as ngs
import numpy as np
import pytest
from netgen.csg import CSGeometry, OrthoBrick, Pnt

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import InputError
from ngbrain.forward.harmonic import Harmonic, Wave
from ngbrain.forward.points import evaluation
from ngbrain.forward.sensitivity import BOUNDARY, WaveModel
from ngbrain.inverse.iterative import Iterative
from ngbrain.inverse.labels import by_label, shares
from ngbrain.inverse.misfit import LeastSquares
from ngbrain.inverse.normal import Normal, by_blocks, preconditioners, regulariser_alone
from ngbrain.inverse.parameters import Fields, Scaled, Unknown
from ngbrain.inverse.regularise import smooth
from ngbrain.inverse.weights import Given
from ngbrain.materials import Shearing, TransverselyIsotropic

SIDE, MIDDLE, RADIUS = 0.04, 0.02, 0.012
SOFT, STIFF = 4000.0 + 1600.0j, 8000.0 + 3200.0j
WAVES = [
    Wave(50.0, {"all": (0, 1e-5 * ngs.x / SIDE, 1e-5)}),
    Wave(50.0, {"all": (1e-5, 0, 1e-5 * ngs.y / SIDE)}),
]


def cube(size):
    geometry = CSGeometry()
    geometry.Add(OrthoBrick(Pnt(0, 0, 0), Pnt(SIDE, SIDE, SIDE)).bc("all"))
    return ngs.Mesh(geometry.GenerateMesh(maxh=size))


def label_at(x):
    return (np.linalg.norm(x - MIDDLE, axis=1) < RADIUS).astype(int)


def body(mesh, law, form="P3", degree=3):
    return Harmonic(mesh, law, WAVES, bulk=2e5, form=form, held="all", quadrature=degree)


@cache
def measured():
    """Points, noisy displacements and the standard deviation of their real and imaginary parts."""
    mesh = cube(0.0101)
    at = shares(mesh, 4, label_at, ["soft", "stiff"])
    parts = [
        by_label(at, {"soft": ngs.CF(a), "stiff": ngs.CF(b)}) for a, b in zip(*map(_parts, (SOFT, STIFF)), strict=True)
    ]
    made = body(mesh, Shearing(parts[0] + 1j * parts[1]), "P3", 4)
    line = np.arange(1e-3, SIDE, 3e-3)
    x = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    observe = evaluation(ngs.H1(mesh, order=3), x)
    n = observe.shape[1]
    u = [np.column_stack([observe @ v.vec.FV().NumPy()[i * n : (i + 1) * n] for i in range(3)]) for v in made.solve()]
    random = np.random.default_rng(5)
    deviation = 0.02 * np.sqrt((np.abs(u) ** 2).mean(axis=1, keepdims=True) / 2)
    return x, u + deviation * (random.normal(size=(2, *x.shape)) + 1j * random.normal(size=(2, *x.shape))), deviation


def _parts(value):
    return value.real, value.imag


@cache
def mesh_of_inversion():
    return cube(0.0141)


def problem(names=("tissue",), weight=1e3, boundary=False, law=None):
    """A `Reduced` with a field for each label, and its `Fields`."""
    mesh, (x, u, deviation) = mesh_of_inversion(), measured()
    at = shares(mesh, 3, label_at if len(names) > 1 else lambda x: np.zeros(len(x), int), names)
    space = ngs.H1(mesh, order=1)
    fields = {f"{part} {name}": ngs.GridFunction(space) for name in names for part in ("storage", "loss")}
    starts = {name: 5000.0 if name.startswith("storage") else 2000.0 for name in fields}
    for name, field in fields.items():
        field.Set(starts[name])
    storage, loss = (by_label(at, {name: fields[f"{part} {name}"] for name in names}) for part in ("storage", "loss"))
    model = WaveModel(body(mesh, (law or Shearing)(storage + 1j * loss)), fields, x)
    unknowns = {name: Unknown(start) for name, start in starts.items()}
    if boundary:
        unknowns[BOUNDARY] = Unknown(model.theta[model.blocks[BOUNDARY]], Scaled(float(deviation.mean())))
    search = Fields(model.theta, model.blocks, unknowns)
    regular = {name: smooth(space, search.start[search.blocks[name]]) for name in fields}
    return Reduced(model, LeastSquares(u, deviation), search, regular, dict.fromkeys(fields, weight)), search


def lowered(normal, precondition, most):
    """½ x·Hx - b·x after so many iterations, with b the way down."""
    b = -normal.gradient()
    normal.precondition, normal.most, normal.forcing = precondition, most, 0.0
    x = normal.solve(b)
    return 0.5 * x @ normal.product(x) - b @ x


def test_inclusion_is_found_with_noise():
    reduced, search = problem(weight=1e3)
    found = Iterative(reduced, Given()).descend(search.start, 5)
    x = measured()[0]
    modulus = evaluation(ngs.H1(mesh_of_inversion(), order=1), x) @ search.values(found.x)["storage tissue"]
    away = np.linalg.norm(x - MIDDLE, axis=1)
    soft, stiff = np.median(modulus[away > RADIUS + 4e-3]), np.median(modulus[away < RADIUS - 4e-3])
    assert soft == pytest.approx(SOFT.real, rel=0.05)  # the search began at 5000
    assert stiff > 1.25 * soft  # a field of 14 mm elements cannot rise by 2 within the ball's 24 mm


def test_labels_keep_a_jump():
    reduced, search = problem(("soft", "stiff"), weight=1e5)
    found = Iterative(reduced, Given()).descend(search.start, 5)
    values = search.values(found.x)
    assert np.median(values["storage soft"]) == pytest.approx(SOFT.real, rel=0.1)
    assert np.median(values["storage stiff"]) == pytest.approx(STIFF.real, rel=0.1)


@pytest.mark.parametrize("boundary", [False, True])
def test_preconditioner_is_symmetric_positive_definite(boundary, rng):
    reduced, search = problem(weight=1e-2, boundary=boundary)
    apply = by_blocks(preconditioners(reduced.at(search.start)), reduced)
    for _ in range(4):
        a, b = rng.normal(size=(2, len(search.start)))
        assert a @ apply(b) == pytest.approx(
            b @ apply(a), rel=1e-8, abs=1e-8 * np.sqrt((a @ apply(a)) * (b @ apply(b)))
        )
        assert a @ apply(a) > 0


def test_preconditioner_beats_the_regulariser():
    reduced, search = problem(weight=1e-2)
    point = reduced.at(search.start)
    normal = Normal(point)
    ours, alone = normal.precondition, by_blocks(regulariser_alone(point), reduced)
    enough = 0.998 * lowered(normal, ours, 150)  # negative
    assert lowered(normal, ours, 18) < enough < lowered(normal, alone, 36)  # half as many iterations


def test_preconditioner_of_a_transversely_isotropic_law():
    reduced, search = problem(law=lambda mu: TransverselyIsotropic(mu, 0.5, 0.5, (1, 0, 0)))
    point = reduced.at(search.start)
    normal = Normal(point, forcing=0.1, most=100)
    normal.solve(-normal.gradient())
    assert normal.iterations[0] < 40


def test_resumed_from_a_checkpoint_has_the_same_bits(tmp_path):
    whole, search = problem(weight=1e4)
    straight = Iterative(whole, most=5).descend(search.start, 3)
    first, _ = problem(weight=1e4)
    Iterative(first, most=5, checkpoint=tmp_path / "part.npz").descend(search.start, 1)
    second, _ = problem(weight=1e4)
    resumed = Iterative(second, most=5, checkpoint=tmp_path / "part.npz").resume(3)
    assert np.array_equal(resumed.x, straight.x)
    assert resumed.weights == straight.weights
    assert [done.expected for done in resumed.history] == [done.expected for done in straight.history]  # its probes
    assert [path.name for path in tmp_path.iterdir()] == ["part.npz"]


def test_what_is_no_checkpoint_is_refused(tmp_path):
    reduced, _ = problem()
    with pytest.raises(InputError):
        Iterative(reduced, checkpoint=tmp_path / "none.npz").resume()


def test_boundary_that_is_off_is_put_right():
    reduced, search = problem(boundary=True, weight=1e4)
    x = search.start.copy()
    block = search.blocks[BOUNDARY]
    x[block] += np.random.default_rng(0).normal(size=block.stop - block.start)
    before = reduced.at(x).misfit
    found = Iterative(reduced, Given(), most=20).descend(x, 2)
    assert found.level.misfit / 2 < 0.5 * before
