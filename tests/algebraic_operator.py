"""Operators without weights: a stand-in for a trained one returns the algebraic modulus estimate of its input channels."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ngbrain.io.waves import WaveData
from ngbrain.surrogate.data.dataset import DENSITY, SIDES, DataSet, sample, solve_displacement
from ngbrain.surrogate.operator.encoding import add_noise
from ngbrain.surrogate.prediction.pretrained import ModelCard, Operator
from ngbrain.surrogate.prediction.trust import calibrate

LINE = np.linspace(0, 1, 5)


class OfWaves:
    """ln |r| and arg r of the curl, of the wide window, as they come; the scale of both is .05."""

    def run(self, _, given):
        size, angle = given["features"][:, 16], given["features"][:, 17]
        mean = np.stack([size + np.log(np.cos(angle)), np.tan(angle)], axis=1)
        return mean, np.full_like(mean, np.log(0.05))


class OfCompression:
    """Modulus by the inverse of the strain."""

    def run(self, _, given):
        mean = -np.clip(given["features"][:, 4:5], -1, 1)
        return mean, np.full_like(mean, np.log(0.05))


def noisy(u, sigma, seed=0):
    """Fields (batch, n, n, components) with noise."""
    return add_noise(u, np.full(len(u), sigma), np.random.default_rng(seed))


@lru_cache
def few(modality, split="train", count=6, across=31):
    """Squares of two families, without noise."""
    rows = [
        sample(modality, name, 0, split, i, across) for name in ("gaussian_width", "tumour") for i in range(count // 2)
    ]
    columns = {
        key: np.array([getattr(row, key) for row in rows]) for key in ("storage", "loss", "frequency", "poisson")
    }
    u = np.array([row.displacement for row in rows])
    family = np.repeat([0, 1], count // 2)
    return DataSet(modality, split, SIDES[modality], "", ("gaussian_width", "tumour"), u, family=family, **columns)


@lru_cache
def algebraic(modality="waves"):
    """An operator of a modality, calibrated on few squares."""
    bare = Operator(ModelCard({"modality": modality}), {"waves": OfWaves, "compression": OfCompression}[modality]())
    found = calibrate(bare, few(modality), few(modality, "validation"))
    return replace(bare, card=ModelCard({**bare.card.content, **found}))


def uniform(shear=6e3 * (1 + 0.2j), frequency=50.0, across=41, **changes):
    """A uniform square driven at its top, as wave data."""
    u = solve_displacement(
        np.full((5, 5), shear), frequency, changes.get("poisson") or 0.3, {"top": (1e-3, 5e-4)}, across
    )
    return square(u, SIDES["waves"], frequency=frequency, truth={"shear": np.full(across**2, shear)}, **changes)


def square(u, side, frequency=0.0, **changes):
    """Displacement (n, n, 2), first axis y, as wave data."""
    line = np.linspace(0, side, len(u))
    points = np.column_stack([part.ravel() for part in np.meshgrid(line, line)])
    given = {
        "symmetry": "isotropic",
        "rheology": "viscoelastic" if frequency else "elastic",
        "poisson": 0.3,
        "density": DENSITY,
    }
    return WaveData(points, u.reshape(1, -1, 2), [frequency], **{**given, **changes})
