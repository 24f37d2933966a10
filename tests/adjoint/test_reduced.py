"""Gradients and products of J for every misfit, regulariser and change of variables; wrong ones are seen."""

from itertools import product
from types import SimpleNamespace

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.adjoint.check import dot, taylor
from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import InputError
from ngbrain.inverse.objective.misfit import Huber, LeastSquares
from ngbrain.inverse.objective.parameters import (
    BoundedTransform,
    LogTransform,
    ParameterFields,
    ScaledTransform,
    Unknown,
)
from ngbrain.inverse.objective.regularisation import matern, ridge, smooth, total_variation
from ngbrain.inverse.phantoms.benchmark import Phantom

MEASURED = Phantom.from_name("CV-G", 6).simulate_measurements(0.3)
"""Noise large enough that some residuals are beyond Huber's threshold."""
MISFITS = {"squares": LeastSquares, "huber": lambda m, s: Huber(m, s, 1.0)}
REGULARISERS = {
    "smooth": smooth,
    "matern": lambda space, x: matern(space, x, 0.03),
    "ridge": lambda _, x: ridge(x),
    "total variation": lambda space, x: total_variation(space, x, 0.03),
}
TRANSFORMS = {
    "log": LogTransform(),
    "floor": LogTransform(-500.0),
    "bounded": BoundedTransform(100.0, 1e5),
    "scaled": ScaledTransform(1e4),
}


def problem(misfit="squares", regulariser="smooth", transform="log"):
    inversion = MEASURED.inversion()
    reduced, start = inversion.reduced, MEASURED.phantom.start
    boundary = reduced.unknowns.unknowns["boundary"]
    unknowns = {name: Unknown(value, TRANSFORMS[transform]) for name, value in start.items()}
    fields = ParameterFields(inversion.model.theta, inversion.model.blocks, unknowns | {"boundary": boundary})
    space = next(iter(inversion.model.fields.values())).space
    made = {name: REGULARISERS[regulariser](space, fields.start[fields.blocks[name]]) for name in start}
    weighed = MISFITS[misfit](MEASURED.displacement, MEASURED.sigma)
    return Reduced(inversion.model, weighed, fields, made, dict.fromkeys(start, 3.0))


def somewhere(reduced, rng):
    x = reduced.unknowns.start
    return x + 0.1 * rng.normal(size=len(x)), rng.normal(size=len(x))


def rates(reduced, gradient, x, dx, first=1e-2):
    return taylor(reduced.value, gradient, x, dx, steps=3, first=first)


@pytest.mark.parametrize(("misfit", "regulariser", "transform"), list(product(MISFITS, REGULARISERS, TRANSFORMS)))
def test_gradient(misfit, regulariser, transform, rng):
    reduced = problem(misfit, regulariser, transform)
    x, dx = somewhere(reduced, rng)
    # Huber's second derivative jumps at the threshold: smaller steps cross it at fewer points.
    first = 1e-3 if misfit == "huber" else 1e-2
    assert np.all(np.abs(rates(reduced, reduced.evaluate(x).gradient(), x, dx, first) - 2) < 0.1)


@pytest.mark.parametrize(("misfit", "regulariser", "transform"), list(product(MISFITS, REGULARISERS, TRANSFORMS)))
def test_the_whole_hessian(misfit, regulariser, transform, rng):
    """Symmetric, and the gradient's derivative, far from where the data fit."""
    reduced = problem(misfit, regulariser, transform)
    x, a = somewhere(reduced, rng)
    b, point = rng.normal(size=len(x)), reduced.evaluate(x)
    along_a, along_b = point.hessian(a), point.hessian(b)
    assert abs(b @ along_a - a @ along_b) < 1e-10 * np.abs(b * along_a).sum()
    first = 1e-4 if misfit == "huber" else 1e-2  # no residual may cross the threshold
    rates = taylor(lambda x: reduced.evaluate(x).gradient(), lambda d: reduced.evaluate(x).hessian(d), x, a, 2, first)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates


def test_a_model_without_second_derivatives_is_refused():
    reduced = problem()
    point = reduced.evaluate(reduced.unknowns.start)
    point.state = SimpleNamespace(data=point.state.data)
    with pytest.raises(InputError, match=r"hvp\(w, direction\)"):
        point.hessian(point.x)


def test_product_is_symmetric_and_positive(rng):
    reduced = problem("huber", "total variation")
    x, a = somewhere(reduced, rng)
    b, point = rng.normal(size=len(x)), reduced.evaluate(x)
    assert dot(point.product, point.product, a, b) < 1e-11
    assert a @ point.product(a) > 0


def test_product_is_the_hessian_where_the_data_fit(rng):
    clean = Phantom.from_name("CV-G", 6).simulate_measurements()
    reduced = clean.inversion().reduced
    truth = {name: Unknown(value) for name, value in clean.truth.items()}
    x = ParameterFields(reduced.model.theta, reduced.model.blocks, truth).start
    dx = rng.normal(size=len(x))
    point = reduced.evaluate(x)
    product_of, gradient = point.product(dx), point.gradient()
    h = 1e-5
    change = (reduced.evaluate(x + h * dx).gradient() - reduced.evaluate(x - h * dx).gradient()) / (2 * h)
    assert np.linalg.norm(product_of - change) < 1e-5 * np.linalg.norm(change) and len(gradient) == len(x)


def test_dropped_factor_of_the_logarithm_is_seen(rng):
    reduced = problem()
    x, dx = somewhere(reduced, rng)
    point = reduced.evaluate(x)
    plain = point.gradient()
    slope = np.exp(x[: reduced.unknowns.blocks["boundary"].start])
    wrong = plain.copy()
    wrong[: len(slope)] = (plain - reduced.regular_gradient(x))[: len(slope)] / slope + reduced.regular_gradient(x)[
        : len(slope)
    ]
    assert rates(reduced, wrong, x, dx)[-1] < 1.3


def test_stale_factor_is_seen(rng):
    reduced = problem()
    x, dx = somewhere(reduced, rng)
    point = reduced.evaluate(x)
    old = reduced.evaluate(x + 0.2).state.factors
    assert np.all(np.abs(rates(reduced, reduced.evaluate(x).gradient(), x, dx) - 2) < 0.1)
    point = reduced.evaluate(x)
    point.state.factors = old
    assert rates(reduced, point.gradient(), x, dx)[-1] < 1.3


def test_conjugated_residual_is_seen(rng):
    reduced = problem()
    x, dx = somewhere(reduced, rng)
    point = reduced.evaluate(x)
    wrong = point.state.gradient(np.conj(reduced.misfit.gradient(point.state.data)))
    assert rates(reduced, point.jacobian.T @ wrong + reduced.regular_gradient(x), x, dx)[-1] < 1.3


def test_boundary_counted_twice_is_seen(rng):
    reduced = problem()
    x, dx = somewhere(reduced, rng)
    wrong = reduced.evaluate(x).gradient()
    wrong[reduced.unknowns.blocks["boundary"]] *= 2
    assert rates(reduced, wrong, x, dx)[-1] < 1.3


def test_total_variation_needs_small_steps_where_nothing_varies(rng):
    """Steps that make a flat field steeper than the rounding of the corner of |∇x| see the corner: a false alarm."""
    space = ngs.H1(Phantom.from_name("CV-G", 6).simulate_measurements().inversion().model.body.mesh, order=1)
    flat = total_variation(space, np.zeros(space.ndof), 1.0)
    x, dx = np.zeros(space.ndof), rng.normal(size=space.ndof)
    assert taylor(flat.value, flat.gradient(x), x, dx, first=1.0)[0] < 1.3
    assert np.all(np.abs(taylor(flat.value, flat.gradient(x), x, dx, first=1e-4) - 2) < 0.1)
    bumpy = x + rng.normal(size=space.ndof)
    assert np.all(np.abs(taylor(flat.value, flat.gradient(bumpy), bumpy, dx) - 2) < 0.1)


def test_regularisers_without_a_block_or_a_weight_are_refused():
    inversion = Phantom.from_name("CV-G", 5).simulate_measurements(0.02).inversion()
    of = inversion.reduced
    with pytest.raises(InputError, match=r"regularisers\.shear is of nothing; wanted: one of storage, loss"):
        Reduced(of.model, of.misfit, of.unknowns, {"shear": ridge(np.zeros(2))}, {"shear": 1.0})
    with pytest.raises(InputError, match=r"weights\.storage is missing"):
        Reduced(of.model, of.misfit, of.unknowns, {"storage": ridge(np.zeros(2))}, {})
    with pytest.raises(InputError, match=r"x is of shape \(3,\)"):
        of.evaluate(np.zeros(3))
