"""Solve counts equal the calls of factors, in every kind of inversion."""

import numpy as np
import pytest
from planewaves import RHO, grid, shear_waves
from waves import square

from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.elastography.invert_3d import invert_in_space
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.optimise.quasi_newton import newton_cg
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.problem.discretisation import discretise
from ngbrain.inverse.uncertainty.credible_maps import uncertainty
from ngbrain.io.waves import WaveData
from ngbrain.materials import Shearing
from ngbrain.solvers.device import CpuFactor, OrderedFactor


class Asked:
    """Calls of factors."""

    made = solved = 0


@pytest.fixture
def asked(monkeypatch):
    """Count the calls at the factors themselves."""
    count = Asked()

    def watch(kind, make, solve):
        def making(self, *arguments, **options):
            count.made += 1
            make(self, *arguments, **options)

        def solving(self, b):
            count.solved += 1
            return solve(self, b)

        monkeypatch.setattr(kind, "__init__", making)
        monkeypatch.setattr(kind, "solve", solving)

    for kind in (CpuFactor, OrderedFactor):
        watch(kind, kind.__init__, kind.solve)
    return count


def data(dim, shear=2500 + 500j, **changes):
    points = grid(*[10] * dim, spacing=4e-3) if dim == 2 else grid(8, 8, 8, spacing=3e-3)
    u = np.array([shear_waves(points, shear, frequency) for frequency in (50.0, 60.0)])
    given = {"symmetry": "isotropic", "rheology": "viscoelastic", "bulk": 2e5} | changes
    return WaveData(points, u, [50.0, 60.0], RHO, **given).with_noise(0.02, seed=0)


def in_the_plane():
    found = invert(Phantom.from_name("CV-G", 9).simulate_measurements(0.02).data())
    assert found.solves.incremental == len(found.history)  # a step each: nothing else is one
    return found.solves


def in_the_plane_without_loss():
    """An inversion that also computes the nearest resonance."""
    return invert(data(2, 3000.0, rheology="elastic"), uniform=False, regulariser="smooth", max_iterations=1).solves


def with_error_bars():
    found = invert(Phantom.from_name("CV-G", 9).simulate_measurements(0.02).data(), uniform=False, regulariser="smooth")
    before = found.solves.incremental
    uncertainty(found).result()
    assert found.solves.incremental > before
    return found.solves


def in_space():
    waves = data(3)
    return invert_in_space(waves, discretise(waves, order=1), max_iterations=1).solves


def by_descent():
    inversion = Phantom.from_name("CV-G", 7).simulate_measurements(0.02).inversion()
    newton_cg(inversion.reduced, inversion.start, max_iterations=2)
    return inversion.model.solves


def by_products():
    inversion = Phantom.from_name("CV-G", 7).simulate_measurements(0.02).inversion()
    found = levenberg_marquardt(inversion.reduced, inversion.start, max_dense=0, max_iterations=2)
    state, before = inversion.reduced.evaluate(found.x).state, inversion.model.solves.incremental
    state.hvp(state.data, np.ones(inversion.model.size))
    assert inversion.model.solves.incremental == before + 2
    return inversion.model.solves


PURPOSES = {
    in_the_plane: {"forward", "incremental", "traces", "checks"},
    in_the_plane_without_loss: {"forward", "incremental", "traces", "checks"},
    with_error_bars: {"forward", "incremental", "traces", "checks"},
    in_space: {"forward", "incremental", "traces", "checks"},
    by_descent: {"forward", "adjoint", "incremental", "traces"},
    by_products: {"forward", "adjoint", "incremental", "traces"},
}


@pytest.mark.parametrize("way", PURPOSES, ids=lambda way: way.__name__)
def test_every_solve_is_counted(way, asked):
    solves = way()
    assert (solves.factorisations, solves.back_substitutions) == (asked.made, asked.solved)
    done = {name for name, number in vars(solves).items() if number} - {"factorisations", "refinements"}
    assert done == PURPOSES[way], solves


def test_refinements_are_counted_too(asked):
    """Discontinuous pressures at K/μ = 10⁸, whose first solution and adjoint need iterative refinement."""
    body = HarmonicProblem(square(4), Shearing(2000.0), [Wave(50.0, {"top": (1e-3, 0)})], bulk=2e11, form="P4/L2(2)")
    factors = body.factorise()
    factors.solve_wave(0, body.prescribed[0])
    assert factors.improved and asked.made == factors.solves.factorisations
    assert factors.solves.forward == 1 and factors.solves.refinements == asked.solved - 1 > 0
    factors.solve(0, np.ones(body.fes.ndof), "adjoint")
    assert factors.solves.adjoint == 1 and factors.solves.back_substitutions == asked.solved
