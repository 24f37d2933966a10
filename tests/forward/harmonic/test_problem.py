"""Bodies for waves: what is refused and how, factors of stiff volume, distance to a resonance."""

from functools import partial

import ngsolve as ngs
import numpy as np
import pytest
from waves import cube, square, strip

from ngbrain.errors import InputError, SolverError
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.harmonic import factors
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import AbsorbingBoundary, Wave
from ngbrain.materials import NeoHooke, Shearing, TransverselyIsotropic
from ngbrain.mesh.geometry.structured import rectangles
from ngbrain.solvers.device import CpuFactor, Device

LAW, PUSHED = Shearing(2000 + 800j), Wave(50.0, {"top": (1e-3, 0)})


def body(law=LAW, waves=(PUSHED,), mesh=None, **options):
    return HarmonicProblem(mesh or square(2), law, waves, **({"bulk": 1e5, "form": "P2"} | options))


REFUSED = {
    "no wave": (lambda: body(waves=()), "waves"),
    "negative frequency": (lambda: Wave(-1.0), "frequency"),
    "endless frequency": (lambda: Wave(np.inf), "frequency"),
    "unknown boundary": (lambda: body(dirichlet="botom"), "bottom"),
    "unknown axis": (lambda: body(dirichlet={"z": "top"}), "axes among x, y"),
    "not held": (lambda: body(dirichlet="bottom"), "boundaries among the Dirichlet ones"),
    "unknown traction": (lambda: body(waves=[Wave(1.0, traction={"up": (0, 1)})]), "boundary"),
    "unknown edge": (lambda: body(absorbing=[AbsorbingBoundary("up", 1.0)]), "boundary"),
    "pressure without bulk": (lambda: body(bulk=None, form="P2/P1"), "bulk"),
    "unstable pair": (lambda: body(form="P2/L2(1)"), "stable pair"),
    "no such form": (lambda: body(form="T2"), "element"),
    "negative density": (lambda: body(density=-1.0), "density"),
    "negative bulk": (lambda: body(bulk=-1.0), "bulk"),
    "law of large strain": (lambda: body(NeoHooke(1e3)), "small strain"),
    "three components in the plane": (lambda: body(waves=[Wave(50.0, {"top": (0, 0, 1)})]), "2 components"),
    "a component that slides": (lambda: body(waves=[Wave(50.0, {"top": (None, 0)})]), "out of `dirichlet`"),
    "force of one component": (lambda: body(waves=[Wave(50.0, force=(1,))]), "2 components"),
    "fibre in space": (lambda: body(TransverselyIsotropic(1e3, 1, 1, (1, 0, 0))).solve(), "fibre"),
    "fibre in the plane": (lambda: body(TransverselyIsotropic(1e3, 1, 1, (1, 0)), kinematics=Axisymmetric()).solve(), "fibre"),
    "revolution of a solid": (lambda: body(mesh=cube(1), kinematics=Axisymmetric()), "dimension"),
    "resonance at rest": (lambda: body(waves=[Wave(0.0)]).factorise().detuning(0), "more than 0 Hz"),
    "complex constant": (lambda: body(Shearing(ngs.CF(2000 + 800j))), r"law is made of a complex constant.*CF\(2000\) \+ 1j"),
    "complex constant of a law of frequency": (lambda: body(lambda omega: Shearing(ngs.CF(2000 + 1j * omega))), "law is"),
    "complex constant within": (lambda: body(Shearing(2 * ngs.IfPos(ngs.x, ngs.CF(2e3 + 1j), 1e3))), "law is"),
    "complex constant of fibres": (lambda: body(TransverselyIsotropic(1e3, 1, ngs.CF(1 + 1j), (1, 0))), "law is"),
    "complex constant of volume": (lambda: body(bulk=ngs.CF(1e5 + 1e3j)), "bulk is made of a complex constant"),
    "the same beside a pressure": (lambda: body(bulk=ngs.CF(1e5 + 1e3j), form="P2/P1"), "bulk is made of a complex constant"),
    "lines that fall": (lambda: rectangles(np.array([0, 1, 0.5]), np.array([0, 1])), "growing"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name):
    make, words = REFUSED[name]
    with pytest.raises(InputError, match=words):
        make()


def test_parts_of_their_own_are_the_number():
    """What the error about complex constants says to write instead."""
    mesh = square(2)
    number, parts, regions = (
        body(Shearing(modulus), mesh=mesh).solve()[0].vec.FV().NumPy()
        for modulus in (
            2000 + 800j,
            ngs.CF(2000) + 1j * ngs.CF(800),
            mesh.MaterialCF({".*": 2000}) + 1j * mesh.MaterialCF({".*": 800}),
        )
    )
    assert parts == pytest.approx(number, rel=1e-12) == regions and np.abs(number).max() > 1e-3


class Thrice(CpuFactor):
    def solve(self, b):
        return 3 * super().solve(b)


SPOILT = Device("spoilt", partial(Thrice, kind="sparsecholesky"))


def test_a_second_factor_where_the_first_is_of_no_use():
    """The factor without pivots is made useless here; the one with pivots gives the same wave."""
    wanted = body(form="P2/P1").solve()[0].vec.FV().NumPy().copy()
    found = (of := body(form="P2/P1", device=SPOILT)).factorise()
    assert found.solve_wave(0, of.prescribed[0]) == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    assert found.solves.factorisations == 2 and len(found.refactored) == 1


def test_no_factor_at_all_is_an_error(monkeypatch):
    monkeypatch.setattr(factors, "PIVOTED", SPOILT)
    with pytest.raises(SolverError, match="50 Hz"):
        body(device=SPOILT).solve()


@pytest.mark.parametrize("ratio", [10, 1e4, 1e6, 1e8])
@pytest.mark.parametrize("form", ["P2/P1", "P4/L2(2)"])
@pytest.mark.parametrize("modulus", [2000.0, 2000 + 800j])
def test_factors_of_stiff_volume(modulus, form, ratio):
    """What a factor leaves is round-off of the largest entries, at any bulk modulus."""
    of = body(Shearing(modulus), bulk=ratio * 2000, form=form, dirichlet="bottom|top", mesh=square(6))
    found = of.factorise()
    x = found.solve_wave(0, of.prescribed[0])
    left = np.where(of.fixed, 0, found.apply(0, x))
    assert np.linalg.norm(left) < 1e-9 * np.linalg.norm(found.apply(0, of.prescribed[0]))


@pytest.mark.parametrize("form", ["P5", "P5/P4"])
def test_detuning_of_a_clamped_slab(form):
    """Its shear waves resonate at ω_j = jπ/L √(G/ρ)."""
    side, modulus, rho = 0.05, 2000.0, 1000.0
    exact = np.pi / side * np.sqrt(modulus / rho) * np.arange(1, 6)
    for omega in (0.7 * exact[0], 1.05 * exact[1], 0.5 * (exact[2] + exact[3])):
        wave = Wave(omega / (2 * np.pi))
        of = body(
            Shearing(modulus), [wave], strip(4, side), bulk=1e6, form=form, dirichlet={"x": ".*", "y": "left|right"}
        )
        nearest = exact[np.argmin(np.abs(exact**2 - omega**2))]
        found = of.factorise().detuning(0)
        assert found == pytest.approx(abs(nearest / omega - 1), abs=2e-4)


def test_detuning_counts_loss():
    side, modulus, xi = 0.05, 2000.0, 0.1
    omega = np.pi / side * np.sqrt(modulus / 1000.0)
    wave, lossy = Wave(omega / (2 * np.pi)), Shearing(modulus * (1 + 2j * xi))
    of = body(lossy, [wave], strip(4, side), bulk=1e6, form="P5", dirichlet={"x": ".*", "y": "left|right"})
    assert of.factorise().detuning(0) == pytest.approx(abs(np.sqrt(1 + 2j * xi) - 1), rel=1e-3)


def test_a_law_of_a_field_need_not_have_numbers():
    mesh = square(2)
    storage = ngs.GridFunction(ngs.H1(mesh, order=1))
    storage.Set(2000.0)
    fields = body(Shearing(storage * (1 + 0.4j)), mesh=mesh).solve()[0]
    numbers = body(LAW, mesh=mesh).solve()[0]
    assert fields.vec.FV().NumPy() == pytest.approx(numbers.vec.FV().NumPy(), rel=1e-10, abs=1e-15)


@pytest.mark.one_thread
def test_frequencies_side_by_side_are_the_same_to_the_last_bit(caplog):
    mesh = rectangles(np.linspace(0, 0.1, 9), np.linspace(0, 0.06, 7))
    stiff = ngs.GridFunction(ngs.H1(mesh, order=2))
    stiff.Set(2000 + 3e4 * ngs.x * ngs.y)
    waves = [
        Wave(f, {"top": (a, 0)}, force=(0, 1j)) for f, a in ((60.0, 1e-3), (40.0, 2e-3), (60.0, 1e-3j), (0.0, 1e-3))
    ]
    body = HarmonicProblem(mesh, Shearing(stiff * (1 + 0.3j)), waves, bulk=1e7, form="P3/P2", dirichlet="top|bottom")
    alone, both = body.solve(), body.solve(executor=2)
    for one, other in zip(alone, both, strict=True):
        np.testing.assert_array_equal(other.vec.FV().NumPy(), one.vec.FV().NumPy())
    assert len({complex(u.components[0](mesh(0.05, 0.03))[0]) for u in both}) == 4  # each in its place
    by_law = HarmonicProblem(
        mesh, lambda omega: Shearing(stiff * (1 + 1e-3j * omega)), waves, form="P2", dirichlet="top|bottom"
    )
    assert len(by_law.solve(executor=2)) == 4
    assert caplog.text.count("in this process") == 1  # a law that no pickle holds
