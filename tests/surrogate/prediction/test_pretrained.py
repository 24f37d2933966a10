"""Shipped weights: errors, detection of untrustworthy data, independence of PyTorch."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from algebraic_operator import noisy

from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.surrogate.data.dataset import DENSITY, FINE, SIDES, sample, solve_displacement
from ngbrain.surrogate.data.random_fields import family
from ngbrain.surrogate.operator.encoding import modality, relative_errors
from ngbrain.surrogate.prediction.predict import predict
from ngbrain.surrogate.prediction.pretrained import Operator
from ngbrain.surrogate.prediction.tiling import TilePrediction
from ngbrain.surrogate.prediction.trust import auc, scores

pytest.importorskip("onnxruntime")
SEED = 20


def looks(operator, rows, sigma=0.01):
    """Inputs and predictions of the operator for samples, with noise."""
    side = SIDES[operator.kind.name]
    u = noisy(np.array([row.displacement for row in rows]), sigma) / side
    nu = np.array([row.poisson for row in rows])
    features = operator.kind.features(u, nu)
    each = zip(u, [row.frequency for row in rows], nu, features, *operator(features), strict=True)
    return [TilePrediction(operator.kind, *parts) for parts in each]


def off(operator, rows, seen):
    kind = operator.kind
    storage, loss = np.array([row.storage for row in rows]), np.array([row.loss for row in rows])
    unit = kind.unit(storage, np.array([row.frequency for row in rows]), DENSITY, SIDES[kind.name])
    return relative_errors(np.array([look.mean for look in seen]), kind.targets(storage, loss, unit))[:, 0]


def samples(name, count, across=51):
    kinds = ("gaussian_width", "sinc", "tumour", "inclusions")
    return [sample(name, kinds[i % 4], SEED, "test", i, across) for i in range(count)]


@pytest.fixture(scope="module")
def waves():
    return Operator.load_default("waves"), samples("waves", 6)


def largest(operator, seen):
    return np.array([max(scores(look, operator.card.trust).values()) for look in seen])


@pytest.mark.parametrize("name, wanted", [("waves", 0.08), ("compression", 0.04)])
def test_new_squares(name, wanted):
    operator, rows = Operator.load_default(name), samples(name, 4)
    assert operator.kind is modality(name)
    assert np.mean(off(operator, rows, looks(operator, rows))) < wanted


def test_twice_as_fine_a_grid(waves):
    operator, _ = waves
    coarse, fine = (samples("waves", 4, across) for across in (51, 101))
    one, two = (np.mean(off(operator, rows, looks(operator, rows))) for rows in (coarse, fine))
    assert two < 1.3 * one


def test_a_batch_is_its_squares_one_by_one(waves):
    operator, rows = waves
    features = operator.kind.features(np.array([row.displacement for row in rows[:3]]), np.full(3, 0.3))
    whole, alone = operator(features), [operator(features[[i]]) for i in range(3)]
    for k in (0, 1):
        np.testing.assert_allclose(whole[k], np.concatenate([each[k] for each in alone]), rtol=1e-4, atol=1e-5)


def test_right_maps_pass_and_those_of_another_square_do_not(waves):
    operator, rows = waves
    seen = looks(operator, rows)
    trust = operator.card.trust
    right = np.array([scores(look, trust)["residual"] for look in seen])
    wrong = [
        scores(TilePrediction(**{**vars(look), "mean": seen[i - 1].mean}), trust)["residual"]
        for i, look in enumerate(seen)
    ]
    assert (right <= trust["threshold"]).mean() > 0.8 and auc(right, np.array(wrong)) > 0.9


def driven(drive=None, frequency=None, shear=None, count=4):
    """Squares like those of the training except for one change; their waves reach the edge opposite to the driven one."""
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, FINE),), indexing="ij")
    rows = samples("waves", count)
    found = []
    for i, row in enumerate(rows):
        random = np.random.default_rng([SEED, i])
        angle = random.uniform(0, 2 * np.pi)
        way = (1e-3 * np.cos(angle), 1e-3 * np.sin(angle))
        edges = {"top": way, **({"bottom": tuple(drive * part for part in way)} if drive is not None else {})}
        fine = (shear or 6e3) * family("gaussian_width")(random, x, y) * (1 + 0.1j)
        hertz = frequency or row.frequency
        u = solve_displacement(fine, hertz, row.poisson, edges, 51)
        found.append(type(row)(u, row.storage, row.loss, hertz, row.poisson))
    return found


@pytest.mark.parametrize(
    "changes",
    [
        {"frequency": 96.0},
        {"frequency": 24.0},
        {"shear": 2.4e4},
        {"shear": 1.5e3},
        {"drive": 0.0, "frequency": 45.0},
        {"drive": -1.0, "frequency": 45.0},
    ],
    ids=["too fast", "too slow", "too stiff", "too soft", "clamped opposite", "both edges"],
)
def test_squares_unlike_the_training_are_told_from_those_like_it(waves, changes):
    operator, rows = waves
    usual = largest(operator, looks(operator, rows))
    assert auc(usual, largest(operator, looks(operator, driven(**changes, count=4)))) >= 0.9


def test_half_of_another_scan_is_not_trusted():
    one, other = (
        replace(Phantom.from_name(name, 33).simulate_measurements(0.02).data(), truth={}) for name in ("CV-G", "CV-B")
    )
    left = one.points[:, 0] < np.median(one.points[:, 0])
    found = predict(replace(one, displacement=np.where(left[None, :, None], other.displacement, one.displacement)))
    assert not found.usable and "jump" in found.reasons[0]
    assert max(score for name, score in found.scores.items() if name != "jump") < found.threshold
    whole = predict(one)
    assert whole.usable and whole.scores["jump"] < 0.5


def test_ten_per_cent_of_noise(waves):
    operator, rows = waves
    assert auc(largest(operator, looks(operator, rows)), largest(operator, looks(operator, rows, 0.1))) >= 0.9


@pytest.mark.parametrize("name", ["waves", "compression"])
def test_twice_the_noise_that_bounds_are_found_with_is_still_within_the_training(name):
    operator, rows = Operator.load_default(name), samples(name, 4)
    assert largest(operator, looks(operator, rows, 0.02)).max() < operator.card.trust["threshold"]


def test_no_torch():
    """Neither for the command line nor for the operator."""
    code = "import sys, ngbrain.cli.predict as _, ngbrain.surrogate.prediction.pretrained as s; s.Operator.load_default('waves')"
    done = subprocess.run(
        [sys.executable, "-c", code + "; print('torch' in sys.modules)"], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"
