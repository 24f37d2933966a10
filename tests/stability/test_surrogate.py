"""A trained operator answers anything. Naive: its own error bars are believed. Ours: numbers that need no truth speak up."""

import numpy as np
import pytest

from ngbrain.surrogate.data.dataset import SIDES, sample, solve_displacement
from ngbrain.surrogate.data.random_fields import family
from ngbrain.surrogate.operator.encoding import add_noise
from ngbrain.surrogate.prediction.tiling import TilePrediction

pytest.importorskip("onnxruntime")

from ngbrain.surrogate.prediction.pretrained import Operator  # noqa: E402
from ngbrain.surrogate.prediction.trust import scores  # noqa: E402

SIDE, POISSON, MANY = SIDES["compression"], 0.49, 4
FREE, HELD = {"x": "bottom", "y": "bottom|top"}, {"x": "bottom|left|right", "y": "bottom|top"}


def squares(held: dict[str, str]) -> tuple[np.ndarray, np.ndarray]:
    """Axial displacements of spots with 1 % noise, and E over its mean."""
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, 201),), indexing="ij")
    found = []
    for seed in range(MANY):
        youngs = 1e4 * family("gaussian_width")(np.random.default_rng(seed), x, y)
        shear = youngs / (2 * (1 + POISSON))
        u = solve_displacement(shear, 0.0, POISSON, {"top": (0, -0.01 * SIDE)}, 51, held, SIDE).real[..., 1:]
        found.append((u, youngs[::4, ::4] / youngs[::4, ::4].mean()))
    u, truth = (np.array(each) for each in zip(*found, strict=True))
    return add_noise(u, np.full(MANY, 0.01), np.random.default_rng(0)) / SIDE, truth


def told(u: np.ndarray) -> list[TilePrediction]:
    operator = Operator.load_default("compression")
    poisson = np.full(len(u), POISSON)
    features = operator.kind.features(u, poisson)
    each = zip(u, np.zeros(len(u)), poisson, features, *operator(features), strict=True)
    return [TilePrediction(operator.kind, *parts) for parts in each]


def covered(looks: list[TilePrediction], truth: np.ndarray) -> float:
    """Share of points inside of 95 % intervals."""
    off = [np.abs(np.log(t) - look.mean[0]) < 1.96 * look.scale[0] for look, t in zip(looks, truth, strict=True)]
    return float(np.mean(off))


def largest(looks: list[TilePrediction]) -> np.ndarray:
    trust = Operator.load_default("compression").card.trust
    return np.array([max(scores(look, trust).values()) / trust["threshold"] for look in looks])


def test_naive_error_bars_are_believed_where_sides_are_held():
    """95 % intervals hold 55 % of the points of squares that nobody has trained with, and 93 % of those like the training."""
    u, truth = squares(HELD)
    assert covered(told(u), truth) < 0.65
    u, truth = squares(FREE)
    assert covered(told(u), truth) > 0.9


def test_ours_are_not():
    """Every one of them is over five times its bound (13 to 480), and none of those like the training is over it (0.8)."""
    assert largest(told(squares(HELD)[0])).min() > 5
    assert largest(told(squares(FREE)[0])).max() < 1


def test_fields_cleaner_than_the_training_are_no_strangers():
    """The noise that is found is a channel: as it is, a perfect field would lie 2.5 decades beyond what was learnt."""
    operator = Operator.load_default("compression")
    one = sample("compression", "gaussian_width", 0, "test", 1, 51)
    u, poisson = one.displacement[None] / SIDE, np.array([one.poisson])
    truth = one.storage / one.storage.mean()

    def error(features: np.ndarray) -> float:
        found = np.exp(operator(features)[0][0, 0])
        return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))

    ours = operator.kind.features(u, poisson)
    naive = ours.copy()
    naive[:, -1] = -5
    assert error(ours) < 0.015 and error(naive) > 1.5 * error(ours)
