"""Property maps of wave data by a trained operator, with standard deviations and out-of-distribution checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.io.waves import WaveData
from ngbrain.io.waves.labelled import map_variables, wave_dataset
from ngbrain.look import maps as drawn
from ngbrain.result import Result, Status
from ngbrain.surrogate.data.raster import UPRIGHT, Raster
from ngbrain.surrogate.prediction.pretrained import ModelCard, Operator
from ngbrain.surrogate.prediction.tiling import FieldPrediction, RasterField, predict_field
from ngbrain.surrogate.prediction.trust import scores

Array = np.ndarray
TYPICAL = 6e3
"""Shear modulus (Pa) that is assumed where Poisson's ratio follows from the bulk modulus."""


WINDOW = 4.0
"""Factor of the standard deviations in a window: for 14 computed ones, with lesions of 0.4 to 4 times the
background in blocks three times as large under an uneven plate, 95 % intervals then cover 79 to 100 %, 97 % on
average.
"""


@dataclass(repr=False, eq=False)
class Prediction(Result):
    """Result of `predict`.

    Parameters
    ----------
    data : WaveData
        The wave data.
    modality : str
        "waves" or "compression".
    card : Card
        Model card of the operator.
    maps : dict of str to numpy.ndarray
        Name → values (n,) at the points of the data, Pa, NaN where left out: storage and loss, or youngs; for
        compression youngs over its mean.
    deviations : dict of str to numpy.ndarray
        Name → standard deviation (n,) of the map, so that 95 % of the errors are within 1.96 of them.
    scores : dict of str to float
        Name → score relative to its bound, see `trust`; the median over several squares, the largest of several
        loads.
    threshold : float
        Largest score of trustworthy maps.
    squares : int
        Number of squares evaluated.
    solves : Solves
        Linear solves of the residual of compression; the operator itself solves nothing.
    """

    data: WaveData
    modality: str
    card: ModelCard
    maps: dict[str, Array]
    deviations: dict[str, Array]
    scores: dict[str, float]
    threshold: float
    squares: int
    solves: Solves

    def coverage_factors(self, share: float) -> dict[str, float]:
        """Name → number of standard deviations on either side of the map that cover this share of the points, from
        the operator's validation.

        Most of a share is covered by fewer than for a normal distribution, as most errors are small. Valid for one
        load: several loads are treated as independent, which errors of the operator are not. Raises `InputError`
        beyond the shares of the calibration.
        """
        return {name: float(number) for name, number in zip(self.maps, self.card.coverage_factors(share), strict=False)}

    @property
    def score(self) -> float:
        """Largest of `scores`."""
        return max(self.scores.values())

    @property
    def value(self) -> dict[str, Array]:
        """The maps."""
        return self.maps

    def plot(self) -> Any:
        """Plot of the maps."""
        return drawn(self.data.points, self.maps, () if self.modality == "compression" else tuple(self.maps))

    def to_xarray(self) -> Any:
        """As `xarray.Dataset`: maps and their standard deviations, on a grid along x, y, z; raises `MissingExtra`."""
        found = map_variables(self.maps)
        if self.modality == "compression":
            found = {
                name: (dims, values, "1", f"{said} over its mean") for name, (dims, values, _, said) in found.items()
            }
        found |= {
            f"{name}_deviation": (found[name][0], values, found[name][2], f"standard deviation of the {found[name][3]}")
            for name, values in self.deviations.items()
        }
        return wave_dataset(self.data, found).assign_attrs(usable=str(self.usable))

    @property
    def headline(self) -> str:
        """Medians of the maps, and the largest score."""
        medians = [f"{name} {np.nanmedian(values):.4g}" for name, values in self.maps.items()]
        return ", ".join([*medians, f"score {self.score:.2g} of {self.threshold:.2g}"])

    @property
    def statistics(self) -> dict[str, float]:
        """Numbers of squares and of linear solves."""
        return {"squares": self.squares, "back_substitutions": self.solves.back_substitutions}

    @property
    def rejected(self) -> bool:
        """Whether the maps contradict the displacements."""
        return not self.scores["residual"] <= self.threshold

    @property
    def reasons(self) -> list[str]:
        """Reasons not to trust the maps, the worst first."""
        if self.score <= self.threshold:
            return []
        over = sorted(
            ((s / self.threshold, name) for name, s in self.scores.items() if s > self.threshold), reverse=True
        )
        words = ", ".join(f"{name} {s:.3g} times its bound" for s, name in over)
        return [
            f"{'the maps contradict the displacements' if self.rejected else 'the data are unlike the training'}: {words}"
        ]


def predict(data: WaveData, operator: Operator | None = None) -> Prediction:
    """Property maps of isotropic data on a plane grid, from waves or from the axial displacement of a compression.

    A compression whose ends do not move as plates do is treated as a window of a larger body, see
    `ultrasound_window`; standard deviations are then larger. Grids that are not square are evaluated in overlapping
    squares. Where several squares cover a point, and for several loads, logarithms are averaged with
    inverse-variance weights.

    Parameters
    ----------
    data : WaveData
        The wave data.
    operator : Operator, optional
        Trained operator; by default the shipped one for such data.

    Returns
    -------
    Prediction
        Maps, standard deviations and scores.

    Raises
    ------
    InputError
        Data of another kind, real parts only of waves with a loss, or no measured square of `raster.LEAST` points
        across.
    MissingExtra
        onnxruntime is not installed.

    Examples
    --------
    >>> import tempfile
    >>> from ngbrain import datasets, read_waves
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path, *_ = datasets.write("waves_plane", folder)
    ...     found = predict(read_waves(path))
    >>> sorted(found.maps)
    ['loss', 'storage']
    """
    if data.symmetry != "isotropic":
        raise InputError("symmetry", data.symmetry, "isotropic: the operator is not trained with fibres; use `invert`")
    if data.motion == "anti_plane":
        raise InputError(
            "motion", "anti_plane", "in_plane: the operator is not trained with anti-plane motion; use `invert`"
        )
    moving = data.frequency > 0
    name = "waves" if moving.any() else "compression"
    if name == "compression" and data.rheology != "elastic":
        raise InputError("rheology", f"{data.rheology}, at rest", "elastic: static data do not determine a loss")
    if data.lacks_imaginary(0.0 if data.noise is None else float(np.max(data.noise))):
        wanted = "complex displacements, or elastic data: from real parts alone the operator predicts almost no loss"
        raise InputError("displacement", "without imaginary parts", wanted)
    raster, views, notes, data = _fields(data, name)
    operator = operator or Operator.load_default(name)
    if operator.kind.name != name:
        raise InputError("operator", f"of {operator.kind.name}", f"one of {name}")
    poisson = _poisson(data, TYPICAL)
    found = [predict_field(operator, view, data.density, poisson) for view in views]
    if data.bulk is not None:
        if name == "waves":
            poisson = _poisson(data, float(np.exp(np.nanmedian([np.nanmedian(each.mean[0]) for each in found]))))
            found = [predict_field(operator, view, data.density, poisson) for view in views]
        whose = (
            "one shear modulus" if name == "waves" else f"a shear modulus of {TYPICAL / 1e3:g} kPa, which is assumed"
        )
        notes.append(f"Poisson's ratio is taken as {poisson:.5g} everywhere: that of the bulk modulus and {whose}")
    trust, wide = operator.card.trust, 1.0
    of_loads = [_scores(each, trust) for each in found]
    checks = 1
    if name == "compression" and max(each["boundary"] for each in of_loads) > trust["threshold"]:
        cut = [predict_field(operator, view, data.density, poisson, window=True) for view in views]
        of_cut, checks = [_scores(each, trust) for each in cut], 2
    if checks > 1 and _largest(of_cut) < _largest(of_loads):  # else plates, but for the noise
        found, of_loads, wide = cut, of_cut, WINDOW
        notes.append(
            "the ends of the data do not move as rigid plates: the data are treated as a window of a larger body, with the "
            "strain divided by its smooth trend; a trend of the stiffness is not recovered, and contrasts are up to a quarter "
            "too close to 1; `invert` uses the measured displacements of the boundary"
        )
    maps, deviations = _combine(data, raster, found)
    deviations = {key: wide * values for key, values in deviations.items()}
    left = int(np.isnan(next(iter(maps.values()))).sum())
    if left:
        notes.append(f"{left} of {len(data.points)} points lie in no square of measured points and are left out")
    if name == "compression":
        notes.append("Young's modulus is determined up to a constant factor: the map is divided by its mean")
    count = sum(len(each.tiles) for each in found)
    return Prediction(
        data,
        name,
        operator.card,
        maps,
        deviations,
        {key: max(each[key] for each in of_loads) for key in of_loads[0]},
        float(trust["threshold"]),
        count,
        Solves(checks * count, checks * count) if name == "compression" else Solves(),
        status=Status.CONVERGED,
        warnings=notes,
    )


def _fields(data: WaveData, name: str) -> tuple[Raster, list[RasterField], list[str], WaveData]:
    """The fields that the operator of a modality evaluates, their raster, remarks, and the data as far as they are used."""
    raster = Raster.from_data(data)
    notes = list(raster.notes)
    loads = [load for load, frequency in enumerate(data.frequency) if (frequency > 0) == (name == "waves")]
    if len(loads) < data.loads:
        notes.append(f"static loads are left out beside waves, {data.loads - len(loads)} of {data.loads}")
    chosen = slice(None)
    if name == "compression":
        raster, data, note = _axial(raster, data)
        notes += [note] if note else []
        chosen = slice(1, None)
    whole: Array = np.asarray(raster.counts[..., chosen].all(axis=-1))
    kept = [load for load in loads if whole[load].any()]
    if not kept:
        raise InputError("displacement", "of one component alone", "both components of a wave at the same points")
    if len(kept) < len(loads):
        notes.append(f"loads without both components are left out, {len(loads) - len(kept)} of {len(loads)}")
    fields = raster.displacement[..., chosen]
    if name == "compression":
        fields = fields.real
    views = [RasterField(fields[k], whole[k], float(data.frequency[k]), raster.spacing) for k in kept]
    return raster, views, notes, data


def _axial(raster: Raster, data: WaveData) -> tuple[Raster, WaveData, str]:
    """Orient the raster with the axial direction as y, from the end that moves less; drop the other component.

    The axial component is the measured one, or of two the one whose ends move most nearly as rigid plates.
    """
    measured, note = raster.counts.any(axis=(0, 1, 2)), ""
    if measured.all():
        u = np.where(raster.counts, raster.displacement.real, np.nan)
        ends = [np.moveaxis(u[..., i], 2 - i, 1)[:, [0, -1]] for i in (0, 1)]
        axial = int(np.argmin([np.nanvar(end, axis=2).mean() / np.nanvar(u[..., i]) for i, end in enumerate(ends)]))
        along = np.abs(raster.axes[axial]) > UPRIGHT
        if along.sum() == 1:
            data = replace(data, displacement=np.where(along, data.displacement, np.nan))
        note = "only the axial component is used, as the operator is trained for ultrasound"
    else:
        axial = int(measured.argmax())
    raster = raster if axial == 1 else raster.transpose()
    first, last = (np.abs(raster.displacement[:, end, :, 1]).sum() for end in (0, -1))
    return (raster if first <= last else raster.flip()), data, note


def _poisson(data: WaveData, shear: float) -> float:
    """Poisson's ratio, given or from the bulk modulus K: (3K - 2G)/(6K + 2G)."""
    if data.bulk is None:
        return float(data.poisson or 0)
    bulk = float(np.real(data.bulk))
    return (3 * bulk - 2 * shear) / (6 * bulk + 2 * shear)


def _combine(
    data: WaveData, raster: Raster, found: Sequence[FieldPrediction]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Maps of all loads at the points of the data, and their standard deviations: lognormal, that of the loss to first order."""
    weight = np.array([np.where(np.isnan(each.mean), 0, 1 / each.variance) for each in found])
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.nansum(weight * np.array([np.nan_to_num(each.mean) for each in found]), axis=0) / weight.sum(axis=0)
        variance = 1 / weight.sum(axis=0)
    mean, variance = (
        np.array([raster.interpolate_to_points(each) for each in images])
        for images in (mean, np.where(np.isnan(mean), np.nan, variance))
    )
    size = np.exp(mean[0])
    relative = np.exp(variance[0] / 2) * np.sqrt(np.expm1(variance[0]))
    if len(mean) == 1:
        size = size / np.nanmean(size)
        return {"youngs": size}, {"youngs": relative * size}
    if data.rheology == "elastic":
        youngs = np.real(data.youngs_of(size))
        return {"youngs": youngs}, {"youngs": relative * youngs}
    loss = size * mean[1]
    off = np.sqrt((relative * loss) ** 2 + variance[1] * size**2)
    return {"storage": size, "loss": loss}, {"storage": relative * size, "loss": off}


def _scores(found: FieldPrediction, trust: Mapping[str, Any]) -> dict[str, float]:
    return _median_scores([scores(look, trust) for look in found.tiles])


def _largest(of_loads: Sequence[dict[str, float]]) -> float:
    return max(max(each.values()) for each in of_loads)


def _median_scores(scores_of_tiles: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: float(np.median([each[name] for each in scores_of_tiles])) for name in scores_of_tiles[0]}
