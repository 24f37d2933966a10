"""Measured curves, and some published ones that come with the package."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import resources

import numpy as np

from ngbrain.errors import InputError, nearest
from ngbrain.look import BriefText
from ngbrain.materials.lab.modes import find_mode


@dataclass(frozen=True, eq=False, repr=False)
class Curve(BriefText):
    """Measured curve of one test.

    Parameters
    ----------
    mode : str
        "uniaxial", "equibiaxial", "planar" or "shear".
    stretches : numpy.ndarray of shape (n)
        Stretch λ or amount of shear γ.
    stress : numpy.ndarray of shape (n)
        Nominal stress (Pa).
    name : str, optional
        Name in results; the mode where left out.
    times : numpy.ndarray of shape (n), optional
        Times (s) from 0 on, of a history of a viscoelastic material; without them the curve is elastic.

    Raises
    ------
    InputError
        Inadmissible stretches, or stresses or times of another shape.

    Examples
    --------
    >>> Curve("planar", [1.0, 1.1], [0.0, 300.0]).label
    'planar'
    """

    mode: str
    stretches: np.ndarray
    stress: np.ndarray
    name: str | None = None
    times: np.ndarray | None = None

    def __post_init__(self) -> None:
        stretches = find_mode(self.mode).check_stretches(self.stretches)
        stress = np.asarray(self.stress, dtype=float)
        if stretches.ndim != 1 or stress.shape != stretches.shape:
            raise InputError("Curve.stress", f"of shape {stress.shape}", f"one for each stretch: {stretches.shape}")
        if not np.isfinite(stress).all() or not np.any(stress):
            raise InputError("Curve.stress", f"of {self.label}", "finite numbers (Pa), not all 0")
        object.__setattr__(self, "stretches", stretches)
        object.__setattr__(self, "stress", stress)
        if self.times is not None:
            times = np.asarray(self.times, dtype=float)
            if times.shape != stretches.shape:
                raise InputError("Curve.times", f"of shape {times.shape}", f"one for each stretch: {stretches.shape}")
            object.__setattr__(self, "times", times)

    @property
    def label(self) -> str:
        """Name of the curve, or its mode."""
        return self.name or self.mode


def check_curves(data: Iterable[Curve]) -> list[Curve]:
    """The curves as a list; raises `InputError` where two have the same name."""
    curves = list(data)
    labels = [curve.label for curve in curves]
    twice = [label for label in labels if labels.count(label) > 1]
    if not curves or twice:
        raise InputError("data", f"curves named {labels}", "at least one Curve, each with a name of its own")
    return curves


def budday(region: str) -> list[Curve]:
    """Mean curves (Pa) of human brain tissue in compression, tension and shear (both directions, symmetric), by region.

    Parameters
    ----------
    region : str
        "cortex", "corona_radiata", "basal_ganglia" or "corpus_callosum".

    Returns
    -------
    list of Curve
        The three curves.

    References
    ----------
    Budday et al. 2017, 10.1016/j.actbio.2016.10.036, as distributed with LivingMatterLab/CANN.

    Examples
    --------
    >>> [(curve.name, curve.mode, float(curve.stress[-1])) for curve in budday("cortex")]
    [('compression', 'uniaxial', 0.0), ('tension', 'uniaxial', 415.1), ('shear', 'shear', 543.5)]
    """
    text = resources.files("ngbrain.materials.lab").joinpath("budday2017.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    regions = [column for column in rows[0] if column not in ("curve", "stretch")]
    if region not in regions:
        raise InputError("region", repr(region), nearest(str(region), regions))
    curves = []
    for name, mode in (("compression", "uniaxial"), ("tension", "uniaxial"), ("shear", "shear")):
        mine = [(float(row["stretch"]), float(row[region])) for row in rows if row["curve"] == name]
        stretches, kilopascals = np.array(mine).T
        if mode == "shear":
            stretches, kilopascals = (np.concatenate([-half[:0:-1], half]) for half in (stretches, kilopascals))
        curves.append(Curve(mode, stretches, 1e3 * kilopascals, name))
    return curves
