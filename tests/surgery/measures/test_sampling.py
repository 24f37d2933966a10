"""Strain, stress and strain rate of a body by region, against closed forms; the largest mean at a singular edge."""

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import Box, OCCGeometry

from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import Branch, NeoHooke, Viscous
from ngbrain.mesh import Cleft, block
from ngbrain.surgery.measures.sampling import (
    AMOUNT,
    BANDS,
    NEIGHBOURHOOD,
    Sampler,
    Sites,
    TissuePart,
    largest_mean,
    tissue_percentiles,
)
from ngbrain.surgery.protocol_run import Peak

SIDE = 0.02
CLEFT = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 4e-3, 12e-3)
EVERYWHERE = {"tissue": TissuePart(ngs.CF(1.0), (0.9, 1.1), 1e3)}


def body_of(law=None):
    mesh = block((SIDE, SIDE, SIDE), SIDE)
    return Problem(mesh, {"tissue": Material(law or NeoHooke(1e3), 1e6)}, {"bottom": 0}, element="P2/P1", history=True)


def deform(body, F, pressure=0.0):
    """Set the homogeneous deformation x = F X."""
    body.u.Interpolate(ngs.CF(tuple(map(tuple, F - np.eye(3))), dims=(3, 3)) * ngs.CF((ngs.x, ngs.y, ngs.z)))
    body.p.Interpolate(ngs.CF(pressure))


def uniaxial(stretch):
    return np.diag([stretch, stretch**-0.5, stretch**-0.5])


def turn(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def test_von_mises_stress_of_a_stretched_and_turned_neo_hookean_block():
    body = body_of(NeoHooke(700.0))
    sampler = Sampler(body, CLEFT, EVERYWHERE)
    deform(body, turn(0.7) @ uniaxial(1.3), pressure=-400.0)
    body.tissue_forces()
    assert sampler(1.0).von_mises == pytest.approx(np.full(len(sampler.sites.near), 700 * (1.3**2 - 1 / 1.3)))


def test_von_mises_stress_is_on_the_current_area():
    """With a volume ratio J and the same isochoric deformation: σ = μ dev(b̄) / J."""
    body = body_of(NeoHooke(700.0))
    sampler = Sampler(body, CLEFT, EVERYWHERE)
    deform(body, 1.1 * uniaxial(1.3))
    body.tissue_forces()
    assert sampler(1.0).von_mises == pytest.approx(np.full(len(sampler.sites.near), 700 * (1.3**2 - 1 / 1.3) / 1.1**3))


def test_von_mises_stress_relaxes_as_the_law_does():
    """A step stretch of a Prony law, held: μ∞ + μ₁ exp(-t/τ) in place of μ."""
    body = body_of(Viscous(NeoHooke(300.0), (Branch(NeoHooke(900.0), 20.0),)))
    sampler = Sampler(body, CLEFT, EVERYWHERE)
    body.begin(1e-9)
    deform(body, uniaxial(1.2))
    body.history.finish()
    body.begin(15.0)
    body.tissue_forces()
    expected = (300 + 900 * np.exp(-15 / 20)) * (1.2**2 - 1 / 1.2)
    assert sampler(15.0).von_mises == pytest.approx(np.full(len(sampler.sites.near), expected))


def test_the_rate_is_that_of_shear_whatever_turns_and_none_of_a_rotation():
    body, rate, dt = body_of(), 0.4, 0.5
    sampler = Sampler(body, CLEFT, EVERYWHERE)

    def sample(t, F):
        deform(body, F)
        body.tissue_forces()
        return sampler(t).rate

    def shear(t):
        return np.eye(3) + rate * t * np.outer([1, 0, 0], [0, 1, 0])

    n = len(sampler.sites.near)
    assert np.all(sampler(0.0).rate == 0)
    in_a_step = (
        np.arcsinh(rate * dt / 2) / dt
    )  # of the stretch γ/2 + √(1 + γ²/4); for short steps half the rate of shear
    assert in_a_step == pytest.approx(rate / 2, rel=2e-3)
    assert sample(dt, shear(dt)) == pytest.approx(np.full(n, in_a_step))
    assert sample(2 * dt, turn(1.0) @ shear(2 * dt)) == pytest.approx(np.full(n, in_a_step))
    assert sample(3 * dt, turn(2.5) @ shear(2 * dt)) == pytest.approx(np.zeros(n), abs=1e-12)


def test_a_restart_has_the_rate_of_a_run():
    body = body_of()
    sampler, again = (Sampler(body, CLEFT, EVERYWHERE) for _ in range(2))
    for t, stretch in ((1.0, 1.05), (3.0, 1.12)):
        deform(body, uniaxial(stretch))
        body.tissue_forces()
        whole = sampler(t)
        if t == 1.0:
            again.start(t)
    assert np.array_equal(whole.rate, again(3.0).rate)
    assert whole.rate == pytest.approx(np.full(len(whole.rate), np.log(1.12 / 1.05) / 2))


def test_each_region_is_held_to_the_range_of_its_own_law():
    body = body_of()
    left = ngs.IfPos(SIDE / 4 - ngs.x, 1.0, 0.0)
    narrow, wide = TissuePart(left, (0.92, 1.08), 1e3), TissuePart(1.0 - left, (0.88, 1.12), 1e3)
    sampler = Sampler(
        body, CLEFT, {"narrow": narrow, "wide": wide, "elsewhere": TissuePart(ngs.CF(0.0), (1.0, 1.0), 1e3)}
    )
    deform(body, uniaxial(1.1))
    body.tissue_forces()
    sample, ml = sampler(1.0), 1e6 * SIDE**3
    everywhere = sampler.sites.ml(np.ones(len(sample.beyond), bool))
    assert sum(everywhere.values()) == pytest.approx(ml) and everywhere["narrow"] == pytest.approx(ml / 4, rel=0.3)
    assert sampler.sites.ml(sample.beyond) == {"narrow": everywhere["narrow"], "wide": 0.0, "elsewhere": 0.0}


@pytest.mark.parametrize(("stretch", "ml"), [(0.66, 0.0), (0.64, 8.0)])
def test_tissue_is_counted_that_is_compressed_so_far_that_surfaces_fold(stretch, ml):
    body = body_of()
    sampler = Sampler(body, CLEFT, EVERYWHERE)
    deform(body, turn(0.4) @ uniaxial(stretch))
    body.tissue_forces()
    sample = sampler(1.0)
    assert Peak.from_sample(sample, sample.statistics(), {}).creased["tissue"] == pytest.approx(ml)


def test_what_no_part_is_of_is_not_sampled():
    body = body_of()
    half = Sampler(body, CLEFT, {"left": TissuePart(ngs.IfPos(SIDE / 2 - ngs.x, 1.0, 0.0), (0.9, 1.1), 1e3)})
    assert np.sum(half.sites.volume) == pytest.approx(SIDE**3 / 2, rel=0.3)
    assert half(0.0).strain.stretch.shape == (len(half.sites.volume), 3)


def test_a_spread_is_weighted_by_volume_and_near_the_site():
    volume = AMOUNT * np.array([1.0, 0.75, 2.0, 50.0, 25.0])
    sites = Sites(volume, np.zeros(5, int), np.array([0, 1, 2, 4]), ("tissue",))
    spread = sites.statistics(3.0, np.array([0.1, 0.3, 0.2, 0.0]))
    # Volumes' middles, of 28.75: 0 at 12.5, .1 at 25.5, .2 at 27, .3 at 28.375.
    expected = [0.1 * (14.375 - 12.5) / 13, 0.2 + 0.1 * (27.3125 - 27) / 1.375, 0.3]
    assert spread.t == 3.0 and [spread.p50, spread.p95, spread.p99] == pytest.approx(expected)
    assert spread.largest == pytest.approx(0.75 * 0.3 + 0.25 * 0.2)


def test_percentiles_near_the_site_are_observables_with_gradients():
    """The observables equal the sampler's values, smoothed and at their own points; the gradient is that of the value."""
    mesh = block((0.06, 0.05, 0.05), 0.012)
    body = Problem(mesh, {".*": Material(NeoHooke(700.0), 1e5)}, {"left": 0}, element="P2/P1", history=True)
    cleft = Cleft(np.array([0.0, 0.025, 0.025]), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), 20e-3, 4e-3, 12e-3)
    parts = {
        "low": TissuePart(ngs.IfPos(0.03 - ngs.y, 1.0, 0.0), (0.0, 9.0), 1e3),
        "high": TissuePart(ngs.CF(0.0), (0.0, 9.0), 1e3),
    }
    shape = ngs.CF((ngs.x * ngs.y, ngs.x * ngs.z - ngs.x * ngs.x, ngs.x * (0.05 - ngs.y))) * 4
    body.u.Set(shape)
    body.tissue_forces()
    sampler, asked = Sampler(body, cleft, parts), tissue_percentiles(cleft, parts)
    spreads, x = sampler(1.0).statistics(), body.x
    assert set(asked) == {f"{name}_p{percent}" for name in ("mps", "oss") for percent in BANDS}
    motion = ngs.GridFunction(body.fes)
    motion.components[0].Set(ngs.CF((ngs.sin(60 * ngs.y), ngs.x * 20, ngs.cos(50 * ngs.z))) * ngs.x * 1e-2)
    direction = np.array(motion.vec.FV().NumPy()) * (body.weights > 0)
    for key, each in asked.items():
        name, percent = key.split("_")
        raw, observed = getattr(spreads[name], percent), each.on(body)
        print(key, raw, observed.raw, observed.value()[0])
        assert observed.raw == pytest.approx(raw, rel=0.03) and observed.value()[0] == pytest.approx(raw, rel=0.05)
        slope, ends = each.gradient(body) @ direction, []
        for step in (1e-4, -1e-4):
            body.x = x + step * direction
            ends.append(observed.value()[0])
        body.x = x
        assert (ends[0] - ends[1]) / 2e-4 == pytest.approx(slope, rel=2e-3), key


def test_near_is_within_the_neighbourhood_of_the_cleft():
    body = Problem(
        block((0.1, 0.01, 0.01), 0.01),
        {"tissue": Material(NeoHooke(1e3), 1e6)},
        {"bottom": 0},
        element="P2/P1",
        history=True,
    )
    sites = Sampler(body, CLEFT, EVERYWHERE).sites
    assert np.sum(sites.volume[sites.near]) == pytest.approx(1e-4 * (CLEFT.opening / 2 + NEIGHBOURHOOD), rel=0.15)


def test_the_largest_mean_at_a_singular_edge_settles_where_the_maximum_does_not():
    """A field r^(-1/2) at an edge: its mean over the quarter cylinder of volume V = π ρ² L/4 around it is 4/3 ρ^(-1/2)."""
    volume = 0.05
    exact = 4 / 3 * np.sqrt(4 * volume / np.pi) ** -0.5
    rule = ngs.IntegrationRule(ngs.TET, 2)
    mesh = ngs.Mesh(OCCGeometry(Box((0, 0, 0), (1, 1, 1))).GenerateMesh(maxh=1.0))
    means, largest = [], []
    for _ in range(4):
        points = mesh.MapToAllElements({ngs.TET: rule}, ngs.VOL)
        values = ((ngs.x**2 + ngs.y**2) ** -0.25)(points).ravel()
        jacobian = np.abs(ngs.Det(ngs.specialcf.JacobianMatrix(3))(points)).ravel()
        means.append(largest_mean(values, jacobian * np.tile(np.array(rule.weights), mesh.ne), volume))
        largest.append(values.max())
        mesh.Refine()
    assert np.array(largest[1:]) == pytest.approx(np.sqrt(2) * np.array(largest[:-1]))  # with every halving
    errors = np.abs(np.array(means) / exact - 1)
    assert np.all(np.diff(errors) < 0) and errors[-1] < 0.005, errors


def test_a_largest_mean_of_more_than_there_is_is_the_mean(rng):
    values, volumes = rng.uniform(size=50), rng.uniform(size=50)
    assert largest_mean(values, volumes, 1e3) == pytest.approx(np.average(values, weights=volumes))
    assert largest_mean(values, volumes, 1e-9) == pytest.approx(values.max())
