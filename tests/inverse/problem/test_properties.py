"""Storage and loss, or magnitude and phase: bounds, moduli, derivatives, accuracy, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import RHO, grid, wave_number
from synthetic_waves import waves

from ngbrain.adjoint.check import taylor
from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import InputError
from ngbrain.inverse.data.quality import noise_deviation
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.elastography.invert_3d import invert_in_space
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.problem.discretisation import discretise, original_discretisation
from ngbrain.inverse.problem.properties import as_moduli, as_polar, material_properties, polar_properties
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData


def test_polar_starts_where_the_moduli_do():
    data = waves(n=9)
    storage, loss = material_properties(data)
    size, phase = polar_properties(data)
    assert (size.name, phase.name) == ("magnitude", "phase") and (phase.lower, phase.upper) == (0, np.pi / 2)
    assert size.start * np.exp(1j * phase.start) == pytest.approx(storage.start + 1j * loss.start)


def test_there_and_back():
    values = {"storage": np.array([2.0, 3.0]), "loss": np.array([1.0, 0.5]), "zeta": np.array([0.1, 0.2])}
    back = as_moduli({name: each for name, each in as_polar(values).items() if name not in ("storage", "loss")})
    assert set(back) == set(values)
    for name, each in values.items():
        np.testing.assert_allclose(back[name], each, rtol=1e-12)
    assert as_polar({"youngs": values["zeta"]}).keys() == as_moduli({"youngs": values["zeta"]}).keys() == {"youngs"}


BODIES = {
    "our elements": lambda: waves("isotropic", "viscoelastic", "compressible", n=9),
    "fibres": lambda: waves("transversely_isotropic", "viscoelastic", "compressible", n=9),
    "the data's elements": lambda: Phantom.from_name("CV-G", 8).simulate_measurements(0.1).data(),
}


@pytest.mark.parametrize("body", BODIES)
def test_gradient_of_polar_unknowns(body, rng):
    data = BODIES[body]()
    made = original_discretisation(data) if data.element else discretise(data, order=2)
    experiment = ElastographyProblem(data, made, polar_properties(data))
    sigma = noise_deviation(data, 0.1)
    unknowns = experiment.unknowns(sigma)
    reduced = Reduced(experiment.model, LeastSquares(experiment.measured, sigma), unknowns, {}, {})
    x = unknowns.start + 0.1 * rng.normal(size=len(unknowns.start))
    dx = rng.normal(size=len(x))
    rates = taylor(reduced.value, reduced.evaluate(x).gradient(), x, dx, steps=3, first=1e-2)
    assert np.all(np.abs(rates - 2) < 0.1)


def test_the_true_phase_predicts_the_data():
    data = waves()
    experiment = ElastographyProblem(data, discretise(data), polar_properties(data))
    off = experiment.predict_from_truth() - experiment.measured
    assert np.linalg.norm(off) < 0.01 * np.linalg.norm(experiment.measured)


def test_a_truth_without_loss_predicts_nothing():
    data = waves(n=9)
    lossless = replace(data, truth={"shear": np.real(data.truth["shear"]) + 0j})
    for kind in (material_properties, polar_properties):
        assert ElastographyProblem(lossless, discretise(data), kind(data)).predict_from_truth() is None


def test_where_the_loss_angle_is_the_same_everywhere_polar_unknowns_find_it():
    data = Phantom.from_name("CV-G", 21).simulate_measurements(0.02).data()
    found = {kind: invert(data, uniform=False, regulariser="smooth", unknowns=kind) for kind in ("moduli", "polar")}
    errors = {kind: each.answers["loss"]["relative_l2_error"] for kind, each in found.items()}
    assert errors["polar"] < 0.6 * errors["moduli"]
    assert set(found["polar"].weights) == {"magnitude", "phase"} and set(found["polar"].maps) == {"storage", "loss"}
    assert found["polar"].determined["phase"] < 0.5 * found["moduli"].determined["loss"]


@pytest.mark.parametrize("bulk", [pytest.param(1e5, marks=pytest.mark.slow), 4e5])  # without pressures 4 and 7 % off
def test_polar_in_space(bulk):
    points = grid(10, 10, 10, spacing=3e-3)
    k = wave_number(2500 + 800j, 80.0)
    u = 1e-5 * np.stack([np.exp(-1j * k * points[:, i]) for i in (1, 2, 0)], axis=1)[None]
    data = WaveData(points, u, [80.0], RHO, "isotropic", "viscoelastic", bulk=bulk).with_noise(0.02, seed=0)
    found = invert_in_space(data, discretise(data, order=2), unknowns="polar", max_iterations=3)
    assert np.median(found.maps["storage"]) == pytest.approx(2500, rel=0.03)
    assert np.median(found.maps["loss"]) == pytest.approx(800, rel=0.08)
    assert set(found.weights) == {"magnitude", "phase"}


def test_elastic_data_have_no_phase():
    data = waves("isotropic", "elastic", "compressible", n=9)
    with pytest.raises(InputError, match="unknowns is 'polar'; wanted: moduli"):
        invert(data, unknowns="polar")


@pytest.mark.parametrize("call", [invert, invert_in_space])
def test_unknowns_that_are_none(call):
    data = waves(n=9)
    if call is invert_in_space:
        points = grid(8, 8, 8)
        u = 1e-5 * np.ones((1, len(points), 3), complex)
        data = WaveData(points, u, [80.0], RHO, "isotropic", "viscoelastic", bulk=2e5)
    with pytest.raises(InputError, match="unknowns is 'polr'; wanted: did you mean 'polar'"):
        call(data, unknowns="polr")


def test_sought_quantities_are_of_one_kind():
    data = waves(n=9)
    (size, _), (_, loss) = polar_properties(data, 2e3), material_properties(data, 2e3)
    with pytest.raises(InputError, match="properties is magnitude, loss; wanted: storage, loss, or magnitude, phase"):
        ElastographyProblem(data, discretise(data), (size, loss))
    with pytest.raises(InputError, match="properties is loss"):
        ElastographyProblem(data, discretise(data), (loss,))
