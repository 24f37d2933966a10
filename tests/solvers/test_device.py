"""What is solved on a GPU is what the processor finds: one matrix, waves and their derivatives, whole inversions."""

import gc
import sys

import ngsolve as ngs
import ngsolve.gpu
import numpy as np
import pytest
from linear_elasticity import MU, elastic
from planewaves import FREQUENCY, RHO, grid, shear_waves

from ngbrain.errors import InputError, MissingExtra, SolverError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.optimise.gauss_newton import GaussNewton
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.io.waves import WaveData
from ngbrain.mesh import block
from ngbrain.mesh.geometry.structured import rectangles
from ngbrain.solvers import device as device_module
from ngbrain.solvers.device import CPU, CudssFactor, Device, NgsolveFactor
from ngbrain.solvers.linear import prepare

HOST = Device("host", NgsolveFactor)


def small(device=CPU):
    return Phantom.from_name("CV-G", 7).simulate_measurements(0.02).inversion(device=device)


def near(found, wanted):
    return np.linalg.norm(found - wanted) <= 1e-10 * np.linalg.norm(wanted)


@pytest.mark.parametrize("number", [1.0, 1.0 + 0.3j])
def test_one_matrix(number, cudss, rng):
    line = np.linspace(0, 1, 5)
    space = ngs.H1(rectangles(line, line), order=3, dirichlet="left", complex=isinstance(number, complex))
    u, v = space.TnT()
    form = ngs.BilinearForm(number * (ngs.grad(u) * ngs.grad(v) - 30 * u * v) * ngs.dx).Assemble()
    b = rng.normal(size=space.ndof)
    device = Device.from_name("cuda")
    cudss.made.clear()
    factors = {each.name: each.factor(form.mat, space.FreeDofs()) for each in (CPU, device)}
    found = {name: factor.solve(b) for name, factor in factors.items()}
    assert near(found["cuda"], found["cpu"]) and found["cuda"].dtype == found["cpu"].dtype
    held = ~np.fromiter(space.FreeDofs(), bool, space.ndof)
    assert held.any() and not found["cuda"][held].any()
    assert [int(kind) for kind in cudss.made] == [1]  # one, half of it
    del factors
    gc.collect()
    assert cudss.live == 0  # also the one that the device was tried with


@pytest.mark.parametrize("number", [1.0, 1.0 + 0.3j])
def test_one_matrix_on_the_host_reference_device(number, rng):
    """What NGSolve's operators do on a GPU, done by what plays one."""
    line = np.linspace(0, 1, 4)
    space = ngs.H1(rectangles(line, line), order=2, dirichlet="left", complex=isinstance(number, complex))
    u, v = space.TnT()
    form = ngs.BilinearForm(number * (ngs.grad(u) * ngs.grad(v) - 30 * u * v) * ngs.dx).Assemble()
    b = rng.normal(size=space.ndof) + (1j * rng.normal(size=space.ndof) if space.is_complex else 0)
    there, here = (make.factor(form.mat, space.FreeDofs()).solve(b) for make in (CPU, HOST))
    assert near(here, there) and here.dtype == there.dtype


def test_waves_and_their_gradient_on_the_host_reference_device(rng):
    states = [small(device).reduced.evaluate(small().start).state for device in (CPU, HOST)]
    there, here = states
    assert near(here.data, there.data) and not here.factors.refactored
    w = rng.normal(size=there.data.shape)
    assert near(here.gradient(w), there.gradient(w))


@pytest.mark.slow
def test_a_whole_inversion_on_the_host_reference_device():
    both = [small(device) for device in (CPU, HOST)]
    there, here = (levenberg_marquardt(each.reduced, each.start, FixedWeights()) for each in both)
    assert here.converged and np.linalg.norm(here.x - there.x) <= 1e-8 * np.linalg.norm(there.x)


def test_the_reference_device_is_no_gpu(monkeypatch):
    monkeypatch.setattr(ngsolve.gpu, "backend", "host")
    with pytest.raises(InputError, match=r"a GPU that NGSolve solves on \(there is none; .*\), or 'cpu'"):
        Device.from_name("ngsolve")


def test_half_of_a_matrix_that_is_not_symmetric_would_be_another(cudss):
    matrix = ngs.la.SparseMatrixd.CreateFromCOO([0, 0, 1], [0, 1, 1], [2.0, 4.0, 1.0], 2, 2)
    assert CudssFactor(matrix, None, symmetric=False).solve(np.array([6.0, 1.0])) == pytest.approx([1, 1])
    assert CudssFactor(matrix, None).solve(np.array([6.0, 1.0])) == pytest.approx([3, 1])


def test_waves_and_their_derivatives(cudss, rng):
    states = [small(device).reduced.evaluate(small().start).state for device in (CPU, Device.from_name("cuda"))]
    there, here = states
    assert near(here.data, there.data) and cudss.solves > 1
    w, direction = rng.normal(size=there.data.shape), rng.normal(size=there.model.size)
    for one, other in (
        (here.gradient(w), there.gradient(w)),
        (here.vjp(w), there.vjp(w)),
        (here.jvp(direction), there.jvp(direction)),
    ):
        assert near(one, other)


@pytest.mark.parametrize(("dense", "off"), [(0, 1e-5), (1000, 1e-8)])  # conjugate gradients magnify round-off
def test_a_whole_inversion_by_levenberg_and_marquardt(dense, off, cudss):
    both = [small(device) for device in (CPU, Device.from_name("cuda"))]
    there, here = (levenberg_marquardt(each.reduced, each.start, FixedWeights(), max_dense=dense) for each in both)
    done = both[1].model.solves
    assert len(cudss.made) - 1 == done.factorisations  # all of it there; one for trying the device
    assert cudss.solves - 1 == done.back_substitutions
    assert here.converged and len(here.history) == len(there.history)
    assert np.linalg.norm(here.x - there.x) <= off * np.linalg.norm(there.x)


def test_conditions_of_optimality(cudss):
    both = [small(device) for device in (CPU, Device.from_name("cuda"))]
    there, here = (GaussNewton(each.reduced, FixedWeights()).from_waves(each.start, each.waves, 3) for each in both)
    assert len(cudss.made) - 1 == len(here.history) > 0  # conditions alone: no waves are solved for
    assert np.linalg.norm(here.x - there.x) <= 1e-8 * np.linalg.norm(there.x)


def plane_waves(points, **bulk):
    u = shear_waves(points, 2500 + 500j)[None]
    return WaveData(points, u, [FREQUENCY], RHO, "isotropic", "viscoelastic", **bulk).with_noise(0.02, seed=0)


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_from_one_call(dim, cudss):
    data = plane_waves(grid(12, 12, spacing=4e-3), poisson=0.4) if dim == 2 else plane_waves(grid(8, 8, 8), bulk=2e5)
    found = invert(data, regulariser="smooth", uniform=False, device="cuda")
    assert np.median(found.maps["storage"]) == pytest.approx(2500, rel=0.05)
    assert len(cudss.made) - 1 >= found.solves.factorisations > 5


def test_what_the_gpu_leaves_is_solved_with_pivots(cudss, monkeypatch):
    inversion = small(Device.from_name("cuda"))
    monkeypatch.setattr(cudss, "solve", lambda self: np.zeros_like(self._b))
    state = inversion.reduced.evaluate(inversion.start).state
    assert near(state.data, small().reduced.evaluate(inversion.start).state.data)
    assert state.factors.refactored == {wave.omega for wave in inversion.model.body.waves}


def test_statics_on_a_gpu(cudss):
    form = elastic("displacement", block((0.02,) * 3, 0.01), 50, condense=True)
    solve = prepare("cudss", form, MU)
    form.Assemble()
    solve()
    assert [int(kind) for kind in cudss.made] == [1, int(form.flags.ToDict()["symmetric"])]


def test_a_name_that_is_none():
    with pytest.raises(InputError, match=r"device is 'cudda'; wanted: did you mean 'cuda'\?"):
        Device.from_name("cudda")
    with pytest.raises(InputError, match="device"):
        invert(None, device="gpu")  # before data are looked at


def test_no_nvmath(monkeypatch):
    monkeypatch.setitem(sys.modules, "nvmath.sparse.advanced", None)
    with pytest.raises(MissingExtra, match=r'nvmath is not installed; get it with: pip install "ngbrain\[gpu\]"'):
        Device.from_name("cuda")
    assert Device.from_name("cpu") is CPU


def test_no_gpu(cudss, monkeypatch):
    monkeypatch.setattr(cudss, "gpu", False)
    with pytest.raises(InputError, match=r"a GPU that cuDSS solves on \(CUDA_ERROR_NO_DEVICE\), or 'cpu'"):
        Device.from_name("cuda")


def test_a_gpu_that_solves_wrongly(cudss, monkeypatch):
    monkeypatch.setattr(cudss, "solve", lambda self: self._b)
    with pytest.raises(InputError, match="2 x 2 unknowns come out as"):
        Device.from_name("cuda")


@pytest.mark.parametrize("name", ["cpu", "cuda"])
def test_no_factor_is_said(name):
    matrix = ngs.la.SparseMatrixd.CreateFromCOO([0, 1], [0, 1], [1.0, 0.0], 2, 2)
    device = Device.from_name(name)
    if name == "cpu":
        device = Device("cpu", lambda matrix, free: matrix.Inverse(free, inverse="none of them"))
    with pytest.raises(SolverError, match="the stiffness cannot be factorised: "):
        device.factor(matrix, what="the stiffness")


def test_auto_is_the_processor_below_what_was_measured(cudss, monkeypatch):
    auto = Device.from_name("auto")
    monkeypatch.setattr(device_module, "CROSSING", 1000)
    assert auto.for_unknowns(999)[0] is CPU and "only from 1000 unknowns on" in auto.for_unknowns(999)[1]
    chosen, note = auto.for_unknowns(1000)
    assert chosen.name == "cuda" and note == "device auto: the GPU, with 1000 unknowns"
    monkeypatch.setattr(cudss, "gpu", False)
    chosen, note = auto.for_unknowns(1000)
    assert chosen is CPU and "CUDA_ERROR_NO_DEVICE" in note


def test_an_inversion_says_what_auto_was():
    data = Phantom.from_name("CV-G", 11).simulate_measurements(0.02).data()
    found = invert(data, uniform=False, max_iterations=1, device="auto")
    assert any(
        note.startswith("device auto: the processor, as a GPU is faster only from 21000") for note in found.warnings
    )
