"""Out-of-distribution scores: whether a prediction can be trusted, from its input, its output and the equations of motion.

Each score is relative to its bound: values above 1 are rare among squares like those of the training. Within a
range a score is 0, a tenth beyond it 1.

frequency   Hz, of the dynamically similar square of the training's size and density, against the training range
softness    log10(1 - 2ν), likewise
modulus     three percentiles of the predicted storage modulus (Pa, likewise), and `wavelength` in ρω²L²; for compression
            `contrast`, of E over its mean
noise       residual of a local cubic fit of the displacement
jump        the same in the worst patch, see `encoding.estimate_jump`: seam of two scans, phase-wrapped patch
features    Mahalanobis distance of means and standard deviations of the channels over nine parts of the square from those of the
            training, along principal axes, with the remainder as one more
deviation   rms of the predicted standard deviations
residual    residual of the equations of motion of the predicted maps (`residual`)
boundary    deviation from the boundary conditions of the training; 0 for a window, see `ultrasound_window`

Bounds are quantiles over squares not used in the training; the largest score decides.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ngbrain.errors import InputError
from ngbrain.surrogate.data import residual, ultrasound_window
from ngbrain.surrogate.data.dataset import DENSITY, SIDES, DataSet
from ngbrain.surrogate.operator.encoding import NOISE, Modality, estimate_jump, estimate_noise
from ngbrain.surrogate.operator.symmetries import apply_random_symmetry
from ngbrain.surrogate.prediction.pretrained import Operator
from ngbrain.surrogate.prediction.tiling import TilePrediction

Array = np.ndarray
JUDGED = 0.01
"""Relative noise of the calibration data."""
ENOUGH = 1000
"""Training squares whose input channels are evaluated."""
PERCENTILES = (10, 50, 90)
PARTS, AXES, FEW = 3, 12, 4
"""Parts along an edge; principal axes kept, at most one for so many squares."""
USUAL, TOGETHER = 0.99, 0.95
"""Shares of squares like those of the training within one bound, and within all of them."""
WIDE = 0.005
"""Share of the training data cut off at either end of a range of moduli, as the ends are single squares."""
STEEP = 10.0
"""Growth of scores beyond a range, of logarithms: a tenth beyond reaches the bound."""
CONSTANT = 1e-6
"""Standard deviation below which a channel counts as constant."""
SHOWN = (0.5, 0.9, 0.99)
"""Quantiles that a card lists."""
COVERED, NORMAL = 0.95, 1.959964
"""Share of errors within so many standard deviations after calibration."""
SHARES = (0.1, 0.25, 0.5, 0.68, 0.8, 0.9, 0.95, 0.98)
"""Shares for which a card lists coverage factors: errors are not normal, most are small and some are large."""


def scores(look: TilePrediction, trust: Mapping[str, Any]) -> dict[str, float]:
    """Scores of a square relative to their bounds; see the module.

    Parameters
    ----------
    look : TilePrediction
        Prediction of the square.
    trust : dict of str to object
        Ranges, bounds and axes, as `calibrate` returns them.

    Returns
    -------
    dict of str to float
        Name → score.
    """
    raw = _raw(look, trust["ranges"], trust["axes"])
    return {name: value / trust["bounds"].get(name, 1.0) for name, value in raw.items()}


def calibrate(operator: Operator, training: DataSet, validation: DataSet, seed: int = 0) -> dict[str, Any]:
    """Calibrate the standard deviations and scores of an operator.

    Parameters
    ----------
    operator : Operator
        Trained operator.
    training : DataSet
        Training data as computed; noise is added as in the training.
    validation : DataSet
        Validation data as computed; noise of `JUDGED` is added.
    seed : int, default 0
        Seed of the noise.

    Returns
    -------
    dict of str to object
        Entries of a card: `temperature` (answers,), `within` with coverage factors (see `SHARES`), and `trust` with
        ranges, bounds and `threshold`, which the largest score of `TOGETHER` of the validation does not exceed.

    Raises
    ------
    InputError
        Predictions of the operator are not finite.
    """
    kind, random = operator.kind, np.random.default_rng(seed)
    ranges = _ranges(kind, training)
    some = np.sort(random.permutation(len(training))[:ENOUGH])
    u, _ = apply_random_symmetry(kind.name, training.displacement[some], training.storage[some, None], random)
    u = kind.add_noise(u, np.exp(random.uniform(np.log(NOISE[0]), np.log(NOISE[1]), len(some))), random)
    axes = _axes(kind, u, training.poisson[some])
    noise = np.concatenate([estimate_noise(each[None]) for each in u])
    noisy = kind.add_noise(validation.displacement, np.full(len(validation), JUDGED), random)
    validation = replace(validation, displacement=noisy)
    looks = _predictions(operator, validation)
    if not all(np.isfinite(look.mean).all() for look in looks):
        raise InputError(
            "operator", "one with predictions that are not finite", "an operator whose training has not failed"
        )
    truths = kind.targets(validation.storage, validation.loss, _units(kind, validation))
    off = np.abs(np.array([look.mean for look in looks]) - truths) / np.array([look.scale for look in looks])
    factor = np.quantile(off, COVERED, axis=(0, 2, 3)) / NORMAL
    within = np.quantile(off, SHARES, axis=(0, 2, 3)) / factor
    looks = [replace(look, scale=look.scale * factor[:, None, None]) for look in looks]
    raw = [_raw(look, ranges, axes) for look in looks]
    usual = {name: np.array([each[name] for each in raw]) for name in raw[0]}
    bounds = {
        name: float(np.quantile(usual[name], USUAL))
        for name in ("jump", "features", "deviation", "residual", "boundary")
    }
    bounds["noise"] = float(np.quantile(noise, 1 - WIDE))
    largest = np.max([values / bounds.get(name, 1.0) for name, values in usual.items()], axis=0)
    quantiles = {name: np.quantile(values, SHOWN).tolist() for name, values in usual.items()}
    trust = {
        "ranges": ranges,
        "axes": axes,
        "bounds": bounds,
        "threshold": max(1.0, float(np.quantile(largest, TOGETHER))),
    }
    return {
        "temperature": (factor * operator.card.temperature).tolist(),
        "within": {"shares": list(SHARES), "deviations": within.T.tolist()},
        "trust": trust | {"quantiles": quantiles},
    }


def auc(inside: Array, outside: Array) -> float:
    """Area under the ROC curve: how often a score of `outside` is larger than one of `inside`, ties counted half.

    Parameters
    ----------
    inside : numpy.ndarray
        Scores of squares like those of the training.
    outside : numpy.ndarray
        Scores of other squares.

    Returns
    -------
    float
        Area, from 0 to 1.

    Examples
    --------
    >>> auc(np.array([1.0, 2.0]), np.array([2.0, 3.0]))
    0.875
    """
    more = np.sign(np.asarray(outside)[:, None] - np.asarray(inside))
    return float((1 + more).mean() / 2)


def _raw(look: TilePrediction, ranges: Mapping[str, Any], axes: Mapping[str, Any]) -> dict[str, float]:
    seen = {"softness": np.log10(1 - 2 * look.poisson), **_percentiles(look.kind, look.mean[0], look.frequency)}
    if look.kind.name == "waves":
        seen["frequency"] = np.log(look.frequency)
    beyond = {name: STEEP * float(np.max(np.abs(v - np.clip(v, *ranges[name])))) for name, v in seen.items()}
    left, boundary = _physics(look)
    return {
        **beyond,
        "noise": float(estimate_noise(look.displacement[None])[0]),
        "jump": float(estimate_jump(look.displacement[None])[0]),
        "features": _distance(_summary(look.features), axes),
        "deviation": float(np.sqrt((look.scale**2).mean())),
        "residual": left,
        "boundary": boundary,
    }


def _physics(look: TilePrediction) -> tuple[float, float]:
    """Residual and boundary score; see `residual`. A window has no plates, and its residual is that of the measured
    displacement.
    """
    if look.measured is not None:
        return ultrasound_window.misfit(look.measured, look.modulus, look.poisson), 0.0
    if look.kind.name == "waves":
        return residual.wave_residual(look.displacement, look.modulus)
    return residual.compression_residual(look.displacement, look.modulus, look.poisson)


def _percentiles(kind: Modality, logarithm: Array, frequency: float) -> dict[str, Array]:
    """Percentiles of ln(modulus) in its unit, and for waves also in Pa."""
    found = np.percentile(logarithm, PERCENTILES)
    if kind.name != "waves":
        return {"contrast": found}
    return {"wavelength": found, "modulus": found + np.log(DENSITY * (2 * np.pi * frequency * SIDES[kind.name]) ** 2)}


def _summary(features: Array) -> Array:
    """Means and standard deviations of each channel over parts of the square."""
    parts = [c for rows in np.array_split(features, PARTS, 1) for c in np.array_split(rows, PARTS, 2)]
    return np.concatenate([f(axis=(1, 2)) for part in parts for f in (part.mean, part.std)]).astype(float)


def _distance(summary: Array, axes: Mapping[str, Any]) -> float:
    off = (summary - axes["mean"]) / axes["spread"]
    along = np.asarray(axes["axes"]) @ off
    across = (off**2).sum() - (along**2).sum()
    return float(np.sqrt((along**2 / axes["variance"]).sum() + across / axes["across"]))


def _axes(kind: Modality, u: Array, poisson: Array) -> dict[str, Any]:
    """Principal axes of the training inputs."""
    seen = np.array([_summary(kind.features(u[[i]], poisson[[i]])[0]) for i in range(len(u))])
    mean, spread = seen.mean(axis=0), seen.std(axis=0)
    spread = np.where(spread > CONSTANT, spread, 1.0)
    off = (seen - mean) / spread
    axes = np.linalg.svd(off, full_matrices=False)[2][: min(AXES, len(seen) // FEW)].round(4)
    along = off @ axes.T
    across = float(((off**2).sum(axis=1) - (along**2).sum(axis=1)).mean())
    found = {"mean": mean, "spread": spread, "axes": axes, "variance": along.var(axis=0)}
    return {name: values.round(5).tolist() for name, values in found.items()} | {"across": across}


def _ranges(kind: Modality, data: DataSet) -> dict[str, Any]:
    """Ranges of the training data, of logarithms."""
    logarithms = np.log(data.storage / _units(kind, data)[:, None, None])
    rows = [_percentiles(kind, *each) for each in zip(logarithms, data.frequency, strict=True)]
    found = {name: np.quantile([row[name] for row in rows], (WIDE, 1 - WIDE), axis=0) for name in rows[0]}
    found["softness"] = np.log10(1 - 2 * np.array([data.poisson.max(), data.poisson.min()]))
    if kind.name == "waves":
        found["frequency"] = np.log([data.frequency.min(), data.frequency.max()])
    return {name: values.tolist() for name, values in found.items()}


def _units(kind: Modality, data: DataSet) -> Array:
    return kind.unit(data.storage, data.frequency, DENSITY, data.side)


def _predictions(operator: Operator, data: DataSet) -> list[TilePrediction]:
    """Predictions of all squares of a data set."""
    u, nu = data.displacement / data.side, data.poisson
    features = operator.kind.features(u, nu)
    mean, scale = operator(features)
    return [
        TilePrediction(operator.kind, *each) for each in zip(u, data.frequency, nu, features, mean, scale, strict=True)
    ]
