"""Identifiability: bulk modulus, scale of quasi-static data, and one of three parameters in a plane of fibres."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest
from synthetic_waves import waves

from ngbrain.errors import InputError
from ngbrain.inverse.elastography.identifiability import (
    bulk_effect,
    bulk_modulus_note,
    fibre_notes,
    fibre_shear_moduli,
    poorly_determined_notes,
    scale_notes,
)
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.problem.discretisation import discretise
from ngbrain.inverse.problem.properties import Property, material_properties
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.materials import TransverselyIsotropic
from ngbrain.mesh.geometry.structured import rectangles


def effect(bulk_over_shear, noise=0.02):
    """Effect of 10 % more bulk modulus on the waves at the true moduli."""
    data = replace(waves(n=9), bulk=5e3 * bulk_over_shear)
    experiment = ElastographyProblem(data, discretise(data))
    unknowns = experiment.unknowns(np.ones(1))
    theta = unknowns.theta(unknowns.start)
    before = experiment.model.evaluate(theta).data
    found = bulk_effect(experiment, theta, noise)
    np.testing.assert_allclose(
        experiment.model.evaluate(theta).data, before, atol=1e-12 * np.abs(before).max()
    )  # it is put back
    return found


def test_bulk_fades_as_its_inverse():
    """The effect falls as 1/K from K/μ = 100 on: far below 2 % of noise at 10⁴, above it at 4."""
    found = [effect(ratio) for ratio in (1e2, 1e3, 1e4)]
    assert found[0] / found[1] == pytest.approx(10, rel=0.7) and found[1] / found[2] == pytest.approx(10, rel=0.1)
    assert found[2] < 0.1 < 1 < effect(4.0)


def test_noise_hides_it():
    assert effect(100.0, 0.01) == pytest.approx(2 * effect(100.0, 0.02))


def test_an_inversion_tells():
    """The effect is in checks and notes, for compressible and nearly incompressible bodies."""
    for poisson, words in ((0.3, "an error of the maps"), (0.4995, "hardly affects the maps")):
        data = replace(Phantom.from_name("CV-G", 9), poisson=poisson).simulate_measurements(0.02).data()
        found = invert(data, uniform=False, regulariser="smooth")
        assert sum(words in note for note in found.warnings) == 1
        assert (found.to_dict()["checks"]["bulk_change_over_noise"] < 1) == (poisson > 0.4)


def test_it_is_not_looked_for():
    data = waves(n=9)
    with pytest.raises(InputError, match=r"properties is bulk.*given"):
        ElastographyProblem(data, discretise(data), (*material_properties(data, 5e3), Property("bulk", 2e4)))
    with pytest.raises(InputError, match=r"properties is youngs; wanted: storage, loss"):
        ElastographyProblem(data, discretise(data), (Property("youngs", 1e4),))
    assert "bulk" in bulk_modulus_note(0.5) and bulk_modulus_note(0.5) != bulk_modulus_note(2.0)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.3])
def test_two_moduli_are_all_that_isochoric_strain_meets(angle, rng):
    """Other μ, ζ, φ with the same μ(1+φ) and μ(1+ζ): the same energy of any strain in the plane that keeps areas."""
    shears, fibre = (2e3, 3e3), (np.cos(angle), np.sin(angle))
    mesh = rectangles(np.linspace(0, 1, 2), np.linspace(0, 1, 2))
    point = mesh(0.3, 0.3)
    a, b = rng.normal(size=2)
    found = []
    for mu in (1e3, 1.7e3):
        law = TransverselyIsotropic(mu, shears[1] / mu - 1, shears[0] / mu - 1, fibre)
        strain = ngs.CF((a, b, b, -a), dims=(2, 2))
        squeezed = ngs.CF((a, b, b, 0.3), dims=(2, 2))
        found.append([law.energy(strain)(point), law.energy(squeezed)(point)])
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-12) and found[0][1] != pytest.approx(found[1][1], rel=1e-3)


def test_moduli_of_fibres():
    maps = {"mu": np.full(4, 2e3), "zeta": np.full(4, 0.5), "phi": np.full(4, 0.2)}
    found = fibre_shear_moduli(maps)
    assert found["shear_along"] == pytest.approx(2400) and found["shear_stretch"] == pytest.approx(3000)
    lossy = fibre_shear_moduli({"storage": np.full(4, 2e3), **{name: maps[name] for name in ("zeta", "phi")}})
    assert lossy["shear_along"] == pytest.approx(2400)
    assert fibre_shear_moduli({"storage": np.ones(3)}) == {} == fibre_shear_moduli({"mu": np.ones(3)})


def test_fibres_are_told_with_errors_where_the_truth_is_known():
    data = waves("transversely_isotropic", "elastic", n=9)
    maps = {name: np.real(values) for name, values in data.truth_views.items()}
    maps["mu"] = 1.1 * maps["mu"]
    notes, errors = fibre_notes(data, maps)
    assert errors == pytest.approx({"shear_along": 0.1, "shear_stretch": 0.1}) and "off by 10 %" in notes[0]
    notes, errors = fibre_notes(replace(data, truth={}), maps)
    assert not errors and "off by" not in notes[0]
    assert fibre_notes(waves(n=9), {"storage": np.ones(81)}) == ([], {})


def test_few_numbers_and_no_scale():
    assert (
        len(poorly_determined_notes({"mu": 40.0, "phi": 0.2})) == 1
        and "0.2 parameters of phi" in poorly_determined_notes({"phi": 0.2})[0]
    )
    still = replace(waves(n=9), frequency=np.zeros(2), bulk=None, poisson=0.4)
    assert scale_notes(still) and not scale_notes(waves(n=9))
