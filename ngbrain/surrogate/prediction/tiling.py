"""Prediction for one field, from one square or several overlapping ones."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ngbrain.look import BriefText
from ngbrain.surrogate.data.dataset import DENSITY, SIDES
from ngbrain.surrogate.data.raster import squares
from ngbrain.surrogate.data.ultrasound_window import remove_strain_trend
from ngbrain.surrogate.operator.encoding import Modality
from ngbrain.surrogate.prediction.pretrained import Operator

Array = np.ndarray
Square = tuple[int, int, int]
LARGEST = 50.0
"""Bound of predicted logarithms: for pure noise an operator may predict hundreds, whose exponential overflows."""


@dataclass(frozen=True, eq=False, repr=False)
class RasterField(BriefText):
    """Displacement field on a raster.

    Parameters
    ----------
    displacement : numpy.ndarray of shape (ny, nx, components)
        Displacement (m).
    counts : numpy.ndarray of shape (ny, nx)
        Mask of the valid points.
    frequency : float
        Frequency (Hz).
    spacing : float
        Distance of points (m).
    """

    displacement: Array
    counts: Array
    frequency: float
    spacing: float


@dataclass(frozen=True, eq=False, repr=False)
class TilePrediction(BriefText):
    """Input and output of the operator for one square.

    Parameters
    ----------
    kind : Modality
        Modality.
    displacement : numpy.ndarray of shape (n, n, components)
        Displacement, y first, in edges.
    frequency : float
        Frequency (Hz) of the dynamically similar square of the training's size and density.
    poisson : float
        Poisson's ratio.
    features : numpy.ndarray of shape (channels, n, n)
        Input channels.
    mean : numpy.ndarray of shape (answers, n, n)
        Mean of ln(G/ρω²L²) and G″/G′, or of ln E.
    scale : numpy.ndarray of shape (answers, n, n)
        Standard deviation of the same.
    measured : numpy.ndarray of shape (n, n), optional
        Measured axial displacement of a window, in edges; `displacement` is then that between plates.
    """

    kind: Modality
    displacement: Array
    frequency: float
    poisson: float
    features: Array
    mean: Array
    scale: Array
    measured: Array | None = None

    @property
    def modulus(self) -> Array:
        """G/ρω²L², complex, or E: (n, n)."""
        size = np.exp(self.mean[0])
        return size * (1 + 1j * self.mean[1]) if len(self.mean) > 1 else size


@dataclass(frozen=True, eq=False, repr=False)
class FieldPrediction(BriefText):
    """Prediction for a field.

    Parameters
    ----------
    mean : numpy.ndarray of shape (answers, ny, nx)
        Mean of ln G (Pa) and G″/G′, or of ln E; NaN outside all squares.
    variance : numpy.ndarray of shape (answers, ny, nx)
        Variance of the same.
    tiles : list of TilePrediction
        Predictions of the squares.
    """

    mean: Array
    variance: Array
    tiles: list[TilePrediction]


def predict_field(
    operator: Operator, view: RasterField, density: float, poisson: float, window: bool = False
) -> FieldPrediction:
    """Prediction of an operator for a field.

    Several squares of waves are no larger than training squares at the highest training frequency. Means are
    weighted by inverse variance. Levels of compression, which are arbitrary in each square, are aligned where
    squares overlap.

    Parameters
    ----------
    operator : Operator
        Trained operator.
    view : RasterField
        Displacement field.
    density : float
        Density (kg/m³).
    poisson : float
        Poisson's ratio.
    window : bool, default False
        Whether the squares are windows, converted to compression between plates.

    Returns
    -------
    FieldPrediction
        Prediction for the field and its squares.
    """
    kind = operator.kind
    places = squares(view.counts, _largest_square(operator, view, density))
    seen = {(i, j, n): _operator_input(view.displacement[i : i + n, j : j + n], window) for i, j, n in places}
    said = [_evaluate(operator, seen, size, poisson) for size in sorted({n for *_, n in places})]
    predictions = {place: each for part in said for place, each in part.items()}
    if kind.name == "waves":
        level = {
            (i, j, n): np.log(density * (2 * np.pi * view.frequency * (n - 1) * view.spacing) ** 2)
            for i, j, n in places
        }
    else:
        level = align_levels({place: mean[0] for place, (_, mean, _) in predictions.items()})
    shape = (len(kind.answers), *view.counts.shape)
    total, weight, count = np.zeros(shape), np.zeros(shape), np.zeros(view.counts.shape)
    for (i, j, n), (_, mean, scale) in predictions.items():
        here = np.s_[:, i : i + n, j : j + n]
        mean = np.concatenate([mean[:1] + level[i, j, n], mean[1:]])
        total[here] += mean / scale**2
        weight[here] += 1 / scale**2
        count[here[1:]] += 1
    with np.errstate(invalid="ignore", divide="ignore"):
        mean, variance = (
            total / weight,
            count / weight,
        )  # squares share their noise: overlap does not reduce the variance
    looks = []
    for (i, j, n), (features, _, scale) in predictions.items():
        here = np.s_[:, i : i + n, j : j + n]
        blended = np.concatenate([mean[here][:1] - level[i, j, n], mean[here][1:]])
        side = (n - 1) * view.spacing
        frequency = view.frequency * side / SIDES[kind.name] * np.sqrt(density / DENSITY)
        u = seen[i, j, n] / side
        measured = view.displacement[here[1:]][..., 0] / side if window else None
        looks.append(TilePrediction(kind, u, frequency, poisson, features, blended, scale, measured))
    return FieldPrediction(mean, variance, looks)


def _largest_square(operator: Operator, view: RasterField, density: float) -> float:
    """Points across the largest square within the training frequencies."""
    if operator.kind.name != "waves":
        return np.inf
    highest = float(np.exp(operator.card.trust["ranges"]["frequency"][1]))
    return 1 + SIDES["waves"] * highest / view.frequency * np.sqrt(DENSITY / density) / view.spacing


def _operator_input(u: Array, window: bool) -> Array:
    return remove_strain_trend(u[..., 0])[..., None] if window else u


def _evaluate(
    operator: Operator, seen: dict[Square, Array], size: int, poisson: float
) -> dict[Square, tuple[Array, Array, Array]]:
    """Input channels, means and standard deviations of the squares of one size."""
    own = [place for place in seen if place[2] == size]
    u = np.array([seen[place] for place in own])
    features = operator.kind.features(u, np.full(len(own), poisson))
    mean, scale = operator(features)
    return dict(zip(own, zip(features, mean.clip(-LARGEST, LARGEST), scale, strict=True), strict=True))


def align_levels(logarithms: dict[Square, Array]) -> dict[Square, float]:
    """Offsets of the logarithms of each square for which overlapping squares agree, by least squares.

    >>> found = align_levels({(0, 0, 4): np.zeros((4, 4)), (0, 2, 4): np.ones((4, 4))})
    >>> [round(value, 6) for value in found.values()]
    [0.5, -0.5]
    """
    places = list(logarithms)
    rows, right = [np.ones(len(places))], [0.0]
    for (a, one), (b, other) in combinations(enumerate(places), 2):
        low, high = np.maximum(one[:2], other[:2]), np.minimum(np.add(one[:2], one[2]), np.add(other[:2], other[2]))
        if (low >= high).any():
            continue
        parts = [
            logarithms[i, j, n][low[0] - i : high[0] - i, low[1] - j : high[1] - j] for i, j, n in (one, other)
        ]  # fmt: skip
        rows.append(np.zeros(len(places)))
        rows[-1][[a, b]] = 1, -1
        right.append(float((parts[1] - parts[0]).mean()))
    found = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
    return dict(zip(places, found.tolist(), strict=True))
