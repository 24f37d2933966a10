"""An operator's answer for one field, of one square or of several that lie over one another."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ngbrain.surrogate.data.dataset import DENSITY, SIDES
from ngbrain.surrogate.data.raster import squares
from ngbrain.surrogate.data.ultrasound_window import remove_strain_trend
from ngbrain.surrogate.operator.encoding import Modality
from ngbrain.surrogate.prediction.pretrained import Operator

Array = np.ndarray
Square = tuple[int, int, int]
LARGEST = 50.0
"""Of an answer: what an operator makes of noise has logarithms in the hundreds, which no number holds the exponential of."""


@dataclass(frozen=True, eq=False)
class RasterField:
    """A field on a raster: displacement (ny, nx, components) m, which points count (ny, nx), Hz, spacing (m)."""

    displacement: Array
    counts: Array
    frequency: float
    spacing: float


@dataclass(frozen=True, eq=False)
class TilePrediction:
    """A square: what the operator saw, and what it said.

    displacement  (n, n, components), first axis y, in edges
    measured      (n, n) axial displacement in edges of a window, of which `displacement` is what it would be under plates
    frequency     Hz, of what comes to the same in a square of the training's size and density
    features      (channels, n, n)
    mean, scale   (answers, n, n), of ln(G/ρω²L²) and G″/G′, or of ln E
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


@dataclass(frozen=True, eq=False)
class FieldPrediction:
    """Mean and variance (answers, ny, nx) of ln G (Pa) and G″/G′, or of ln E; NaN in no square. And the squares."""

    mean: Array
    variance: Array
    tiles: list[TilePrediction]


def predict_field(
    operator: Operator, view: RasterField, density: float, poisson: float, window: bool = False
) -> FieldPrediction:
    """What an operator says of a field; density in kg/m³. Squares of a `window` are looked at as if under plates.

    Squares of waves are no larger than trained ones at the highest trained frequency, where there are several. Means are weighted
    by the inverse variance. Levels of compression, which are of each square's own, are brought together where squares overlap.
    """
    kind = operator.kind
    places = squares(view.counts, _most(operator, view, density))
    seen = {(i, j, n): _seen(view.displacement[i : i + n, j : j + n], window) for i, j, n in places}
    said = [_said(operator, seen, size, poisson) for size in sorted({n for *_, n in places})]
    told = {place: each for part in said for place, each in part.items()}
    if kind.name == "waves":
        level = {
            (i, j, n): np.log(density * (2 * np.pi * view.frequency * (n - 1) * view.spacing) ** 2)
            for i, j, n in places
        }
    else:
        level = align_levels({place: mean[0] for place, (_, mean, _) in told.items()})
    shape = (len(kind.answers), *view.counts.shape)
    total, weight, count = np.zeros(shape), np.zeros(shape), np.zeros(view.counts.shape)
    for (i, j, n), (_, mean, scale) in told.items():
        here = np.s_[:, i : i + n, j : j + n]
        mean = np.concatenate([mean[:1] + level[i, j, n], mean[1:]])
        total[here] += mean / scale**2
        weight[here] += 1 / scale**2
        count[here[1:]] += 1
    with np.errstate(invalid="ignore", divide="ignore"):
        mean, variance = total / weight, count / weight  # squares share their noise: several are no better than one
    looks = []
    for (i, j, n), (features, _, scale) in told.items():
        here = np.s_[:, i : i + n, j : j + n]
        blended = np.concatenate([mean[here][:1] - level[i, j, n], mean[here][1:]])
        side = (n - 1) * view.spacing
        frequency = view.frequency * side / SIDES[kind.name] * np.sqrt(density / DENSITY)
        u = seen[i, j, n] / side
        measured = view.displacement[here[1:]][..., 0] / side if window else None
        looks.append(TilePrediction(kind, u, frequency, poisson, features, blended, scale, measured))
    return FieldPrediction(mean, variance, looks)


def _most(operator: Operator, view: RasterField, density: float) -> float:
    """Points across the largest square that is within the trained frequencies."""
    if operator.kind.name != "waves":
        return np.inf
    highest = float(np.exp(operator.card.trust["ranges"]["frequency"][1]))
    return 1 + SIDES["waves"] * highest / view.frequency * np.sqrt(DENSITY / density) / view.spacing


def _seen(u: Array, window: bool) -> Array:
    return remove_strain_trend(u[..., 0])[..., None] if window else u


def _said(
    operator: Operator, seen: dict[Square, Array], size: int, poisson: float
) -> dict[Square, tuple[Array, Array, Array]]:
    """Features, means and scales of the squares of one size."""
    own = [place for place in seen if place[2] == size]
    u = np.array([seen[place] for place in own])
    features = operator.kind.features(u, np.full(len(own), poisson))
    mean, scale = operator(features)
    return dict(zip(own, zip(features, mean.clip(-LARGEST, LARGEST), scale, strict=True), strict=True))


def align_levels(logarithms: dict[Square, Array]) -> dict[Square, float]:
    """What to add to the logarithms of each square, so that they agree where squares overlap, by least squares.

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
