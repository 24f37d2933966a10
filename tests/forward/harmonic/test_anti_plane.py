"""Anti-plane shear, G ∇²u = -ρω²u with motion through the plane: closed form at every order, derivatives, what is refused."""

import ngsolve as ngs
import numpy as np
import pytest
from waves import number, square

from ngbrain.adjoint.check import dot, taylor
from ngbrain.errors import InputError
from ngbrain.forward.common.kinematics import AntiPlane
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import AbsorbingBoundary, Wave
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveModel
from ngbrain.materials import Shearing

G, FREQUENCY, SIDE = 2000 + 800j, 60.0, 0.05
DIRECTION = np.array([0.6, 0.8])


def plane_wave():
    k = complex(number(G, 2 * np.pi * FREQUENCY))
    return 1e-5 * ngs.exp(-1j * k * (DIRECTION[0] * ngs.x + DIRECTION[1] * ngs.y))


def error(order, n=4):
    mesh, exact = square(n, SIDE), plane_wave()
    body = HarmonicProblem(
        mesh, Shearing(G), [Wave(FREQUENCY, {".*": exact})], form=f"P{order}", dirichlet=".*", kinematics=AntiPlane()
    )
    (u,) = body.solve()
    off, whole = (ngs.Integrate(f * ngs.Conj(f), mesh, order=14).real for f in (u - exact, exact))
    return np.sqrt(off / whole)


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_a_plane_wave_converges_at_the_order_of_the_elements(order):
    n = 12 if order == 1 else 3
    coarse, fine = error(order, n), error(order, 2 * n)
    assert np.log2(coarse / fine) == pytest.approx(order + 1, abs=0.45)


def test_it_is_the_wave_through_a_slab_in_space():
    """The same waves in three dimensions, between rollers that let z alone move."""
    exact, mesh = plane_wave(), ngs.Mesh(_cube())
    still = ngs.CF((0, 0, exact))
    body = HarmonicProblem(mesh, Shearing(G), [Wave(FREQUENCY, {".*": still})], bulk=1e6, form="P3", dirichlet=".*")
    (u,) = body.solve()
    flat = square(6, SIDE)
    alone = HarmonicProblem(flat, Shearing(G), [Wave(FREQUENCY, {".*": exact})], form="P3", kinematics=AntiPlane())
    (w,) = alone.solve()
    for x, y in ((0.011, 0.02), (0.03, 0.041)):
        assert u(mesh(x, y, 0.005))[2] == pytest.approx(w(flat(x, y)), rel=1e-2)


def _cube():
    from netgen.csg import CSGeometry, OrthoBrick, Pnt

    geometry = CSGeometry()
    geometry.Add(OrthoBrick(Pnt(0, 0, 0), Pnt(SIDE, SIDE, 0.01)))
    return geometry.GenerateMesh(maxh=0.01)


def model(mesh, translation=False):
    """Storage, loss and the exponent of frequency as fields, at two frequencies, an absorbing edge."""
    space, fields = ngs.H1(mesh, order=2), {}
    for name, value in (("storage", 2000.0), ("loss", 700.0), ("exponent", 0.6)):
        fields[name] = ngs.GridFunction(space)
        fields[name].Set(value * (1 + 0.2 * ngs.sin(70 * ngs.x) * ngs.cos(50 * ngs.y)))
    modulus = fields["storage"] + 1j * fields["loss"]
    loads = [Wave(40.0, {"top": (1e-3,)}), Wave(80.0, {"bottom": (1e-3j,)})]
    body = HarmonicProblem(
        mesh,
        lambda omega: Shearing(modulus * (1.0 if omega < 300 else ngs.exp(fields["exponent"] * np.log(2.0)))),
        loads,
        form="P3",
        dirichlet="bottom|top",
        kinematics=AntiPlane(),
        absorbing=[AbsorbingBoundary("left", 2000 + 700j)],
        translation=translation,
    )
    return WaveModel(body, fields, np.array([[0.01, 0.02], [0.03, 0.011], [0.04, 0.04]]))


@pytest.mark.parametrize("translation", [False, True])
def test_derivatives_by_taylor_and_transpose(rng, translation):
    of = model(square(3, SIDE), translation)
    theta, shape = of.theta, of.evaluate(of.theta).data.shape
    assert shape == (2, 3, 1)
    target = of.evaluate(theta).data + 1e-3 * (rng.normal(size=shape) + 1j * rng.normal(size=shape))
    there = of.evaluate(theta)
    slope = there.gradient(there.data - target)
    assert np.allclose(slope, there.vjp(there.data - target), rtol=1e-9, atol=1e-12 * np.abs(slope).max())

    def value(x):
        return float(0.5 * np.sum(np.abs(of.evaluate(x).data - target) ** 2))

    for block in of.blocks.values():
        direction = np.zeros(of.size)
        direction[block] = rng.normal(size=block.stop - block.start) * max(np.abs(theta[block]).max(), 1e-4)
        rates = taylor(value, slope, theta, direction, first=2e-3)
        assert np.all((rates > 1.9) & (rates < 2.1)), rates
        there, w = of.evaluate(theta), rng.normal(size=shape) + 1j * rng.normal(size=shape)
        assert dot(there.jvp, there.vjp(w), direction, w) < 1e-10


def test_a_translation_is_what_u_leaves_out_of_the_inertia():
    """What is left of a wave when a number is subtracted solves the problem whose body moves by that number."""
    mesh, shift = square(3, SIDE), 3e-6 - 2e-6j
    whole, rest = (
        HarmonicProblem(
            mesh, Shearing(G), [Wave(FREQUENCY, {".*": u})], form="P3", kinematics=AntiPlane(), translation=moves
        )
        for u, moves in ((plane_wave(), False), (plane_wave() - shift, True))
    )
    (u,) = whole.solve()
    driven = rest.prescribed[0].copy()
    driven[-1] = shift
    left = rest.factorise().solve_wave(0, driven)[:-1]
    constant = ngs.GridFunction(whole.fes)
    constant.Set(shift)
    assert np.allclose(left, u.vec.FV().NumPy() - constant.vec.FV().NumPy(), atol=1e-12)
    with pytest.raises(InputError, match="translation is True; wanted: False, except in anti-plane motion"):
        HarmonicProblem(mesh, Shearing(G), [Wave(FREQUENCY)], bulk=1e5, translation=True)


def test_volume_does_not_change_so_that_nothing_of_it_is_taken():
    mesh = square(2, SIDE)
    for more in ({"bulk": 1e5}, {"bulk": 1e5, "form": "P2/P1"}):
        with pytest.raises(InputError, match="is isochoric"):
            HarmonicProblem(mesh, Shearing(G), [Wave(FREQUENCY)], kinematics=AntiPlane(), **more)
    with pytest.raises(InputError, match="a vector of 2 components; wanted: 1"):
        HarmonicProblem(mesh, Shearing(G), [Wave(FREQUENCY, {"top": (1, 0)})], kinematics=AntiPlane())
