"""The uncertain numbers of one patient, their prior, and draws of them that all plans share.

A draw of the whole patient is used for every plan, so that what the plans have in common cancels in their differences.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ngbrain.errors import InputError
from ngbrain.materials import CATALOGUE, Ogden
from ngbrain.materials.catalogue import Published
from ngbrain.materials.viscous import viscous
from ngbrain.scene import Tissue
from ngbrain.surgery.twin.case import Link, StiffnessData
from ngbrain.surgery.twin.stiffness import RelativeStiffness
from ngbrain.surgery.uncertainty.material_uncertainty import Comparable, comparable_moduli

Array = np.ndarray
LEVEL, LINK, STIFFENING, RELAXATION = "level", "link exponent", "stiffening", "relaxation"
SHIFT = ("map shift x", "map shift y", "map shift z")
TISSUE, PLACE, LESION = "tissue ", "place ", "lesion "
"""Beginnings of the names of parameters that there are several of."""
FLUID_FACTOR = 2.0
"""One standard deviation, as a factor, of tissue without a norm, such as the filling of a drained cavity."""
LEAST_STIFFENING = 1.1
"""Smallest standard deviation of exponents, as a factor, where the catalogue has too few comparable ones."""


@dataclass(frozen=True)
class Uncertain:
    """One uncertain number: Gaussian, or uniform.

    Parameters
    ----------
    name : str
    source : str
        What it belongs to; shares of the variance are added up over a source.
    centre : float
        Median.
    deviation : float
        Standard deviation of a Gaussian.
    bounds : tuple of float, optional
        Of a uniform distribution, in place of that.
    """

    name: str
    source: str
    centre: float = 0.0
    deviation: float = 0.0
    bounds: tuple[float, float] | None = None

    def quantile(self, probability: Array) -> Array:
        """Values at probabilities between 0 and 1."""
        if self.bounds is not None:
            low, high = self.bounds
            return np.asarray(low + (high - low) * probability)
        return np.asarray(self.centre + self.deviation * scipy.special.ndtri(probability))


@dataclass(frozen=True, eq=False)
class Prior:
    """The uncertain numbers of a patient, which are independent.

    Parameters
    ----------
    numbers : tuple of Uncertain
    notes : tuple of str
        Where the spreads come from, a sentence each.
    """

    numbers: tuple[Uncertain, ...]
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names, in order."""
        return tuple(each.name for each in self.numbers)

    @property
    def sources(self) -> tuple[str, ...]:
        """Source of each number."""
        return tuple(each.source for each in self.numbers)

    @property
    def centre(self) -> Array:
        """Medians."""
        return np.array([each.centre for each in self.numbers])

    def draws(self, count: int, seed: int = 0) -> Array:
        """Draws of the whole patient (count, numbers), by a scrambled Sobol sequence.

        The first ones of a longer sequence are those of a shorter one.

        Parameters
        ----------
        count : int
        seed : int

        Returns
        -------
        array

        Examples
        --------
        >>> two = Prior((Uncertain("a", "a", 0.0, 1.0), Uncertain("b", "b", bounds=(0.0, 1.0), centre=0.5)))
        >>> drawn = two.draws(256)
        >>> drawn.shape, bool(abs(drawn[:, 0].std() - 1) < 0.05), bool(abs(drawn[:, 1].mean() - 0.5) < 0.01)
        ((256, 2), True, True)
        """
        if count < 1:
            raise InputError("draws", count, "a number of draws, at least 1")
        sequence = scipy.stats.qmc.Sobol(len(self.numbers), rng=np.random.default_rng(seed))
        power = max(1, math.ceil(math.log2(count)))
        uniform = np.clip(sequence.random_base2(power)[:count], 1e-9, 1 - 1e-9)
        return np.column_stack([each.quantile(column) for each, column in zip(self.numbers, uniform.T, strict=True)])


def patient_prior(
    tissues: Sequence[Tissue],
    ramp: float,
    link: Link,
    stiffness: RelativeStiffness,
    data: StiffnessData | None,
) -> Prior:
    """The prior of one patient.

    Parameters
    ----------
    tissues : sequence of Tissue
        Of the scene.
    ramp : float
        Time (s) in which the tool opens the cleft: published moduli are compared at this time.
    link : Link
        Spreads that the case states.
    stiffness : RelativeStiffness
    data : StiffnessData, optional
        Errors of the map that the case states.

    Returns
    -------
    Prior
    """
    solid = [tissue for tissue in tissues if stiffness.normal[tissue.region] is not None]
    if not solid:
        found = ", ".join(tissue.region for tissue in tissues)
        raise InputError(
            "norm", f"without any of the scene's tissues ({found})", "a norm with a [[tissue]] for one of them"
        )
    comparable = {tissue.region: comparable_moduli(tissue.region, tissue, ramp) for tissue in solid}
    factor, note = _level(link, comparable, data is not None)
    level = math.hypot(math.log(factor), stiffness.norm_deviation if data is not None else 0.0)
    low, high = link.exponent
    stiffening, why = _stiffening(link, comparable)
    numbers = [
        Uncertain(LEVEL, "level of the whole patient", 0.0, level),
        Uncertain(LINK, "link from waves to a retraction", (low + high) / 2, bounds=(low, high)),
        Uncertain(STIFFENING, "stiffening with strain", 0.0, math.log(stiffening)),
        Uncertain(RELAXATION, "relaxation times", 0.0, math.log(link.relaxation_factor)),
    ]
    for tissue in tissues:
        spread = link.region_factor if tissue in solid else FLUID_FACTOR
        source = "differences between tissues" if tissue in solid else "fluid-filled spaces"
        numbers.append(Uncertain(TISSUE + tissue.region, source, 0.0, math.log(spread)))
    words = "error of the map" if data is not None else "differences from person to person"
    numbers += [Uncertain(f"{PLACE}{k}", words, 0.0, 1.0) for k in range(len(stiffness.places))]
    if data is not None and data.registration > 0:
        numbers += [Uncertain(name, "place of the map", 0.0, data.registration) for name in SHIFT]
    for lesion in stiffness.lesion_priors:
        spread = math.log(lesion.ratio_factor)
        numbers.append(Uncertain(LESION + lesion.name, "lesions", math.log(lesion.ratio), spread))
    return Prior(tuple(numbers), (note, why, f"all relaxation times by a factor of {link.relaxation_factor:g}"))


def _level(link: Link, comparable: dict[str, Comparable], measured: bool) -> tuple[float, str]:
    """Spread of the level of the whole patient, and why."""
    if link.level_factor is not None:
        return link.level_factor, f"the level by a factor of {link.level_factor:g}, as the case states"
    if measured:
        words = "between a patient's small-strain modulus at tens of hertz and that of a retraction"
        return link.patient_factor, f"the level by a factor of {link.patient_factor:g}, {words}"
    squares = [math.log(mean) ** 2 + math.log(by) ** 2 for mean, by in (each.spread for each in comparable.values())]
    band = math.exp(math.sqrt(sum(squares) / len(squares) + math.log(link.patient_factor) ** 2))
    return band, (
        f"the level by a factor of {band:.3g}: that of comparable published moduli about the scene's, and "
        f"{link.patient_factor:g} from person to person"
    )


def _stiffening(link: Link, comparable: dict[str, Comparable]) -> tuple[float, str]:
    """Spread of the exponents of Ogden's law among comparable published tissues."""
    if link.stiffening_factor is not None:
        return link.stiffening_factor, f"exponents by a factor of {link.stiffening_factor:g}, as the case states"
    found = {name: _exponent(CATALOGUE[name]) for each in comparable.values() for name in each.moduli}
    known = [math.log(value) for value in found.values() if value is not None]
    by = math.exp(float(np.std(known))) if len(known) > 1 else 1.0
    return max(by, LEAST_STIFFENING), (
        f"exponents by a factor of {max(by, LEAST_STIFFENING):.3g}, as of {len(known)} comparable published laws"
    )


def _exponent(entry: Published) -> float | None:
    law = viscous(entry.law()).equilibrium
    return abs(float(np.ravel(law.alpha)[0])) if isinstance(law, Ogden) else None  # type: ignore[arg-type]
