"""Coarse answers of an operation, and the intervals in which those of the scene as described should lie.

An interval has two sources: the scene is computed on two coarse meshes, and a record of other scenes says by how many times their
difference the answers of a scene's own mesh and time steps were off (`benchmarks/quick_answers.py` makes the record and tests it).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources

import numpy as np
import scipy

from ngbrain.look import BriefText
from ngbrain.scene import Scene

MAIN = ("peak_pressure_mmHg", "dose_mmHg_min", "peak_force_N", "mps_p95")
"""The answers with an interval: peak pressure, dose, force, strain."""
COARSE = {"wall": math.sqrt(2) * 4e-3, "craniotomy": 14e-3, "largest": 36e-3}
"""Element sizes (m) of the coarse mesh, unless the scene's are larger; larger ones away from the cleft would cut off parts of the
brain.
"""
COARSER = math.sqrt(2)
"""Size on the cleft's walls of the second mesh, relative to the first."""
LESS = 0.85
"""A scene whose elements on the walls are larger than this part of the coarse ones is computed as described at once."""
TOLERANCE, RAMP, HOLD = 0.1, 1 / 2, 1 / 8
"""Of time steps: relative error; longest step while the tool pushes, as a part of the ramp, and while it rests, of the whole."""
COVERAGE = 0.9
"""Probability with which all answers of a scene lie in their intervals."""
RECORD = "coarse_answers.json"


def has_coarse(scene: Scene) -> bool:
    """Whether a coarse mesh has clearly larger elements than the scene's own.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    bool
    """
    return scene.mesh.wall < LESS * COARSE["wall"]


def coarse_scene(scene: Scene, coarser: bool = False) -> Scene:
    """The scene with large elements of second order and long time steps.

    Parameters
    ----------
    scene : Scene
    coarser : bool
        With larger elements still on the walls of the cleft.

    Returns
    -------
    Scene

    Examples
    --------
    >>> coarse = coarse_scene(Scene.shipped("demo"))
    >>> round(1e3 * coarse.mesh.wall, 2), coarse.time.max_step_contact, coarse.protocols == Scene.shipped("demo").protocols
    (5.66, 5.0, True)
    """
    mesh = replace(scene.mesh, order=2).with_minimum(COARSE)
    mesh = replace(mesh, wall=COARSER * mesh.wall) if coarser else mesh
    time = scene.time
    steps = replace(
        time,
        step_tolerance=max(TOLERANCE, time.step_tolerance),
        max_step_contact=max(RAMP * time.ramp, time.max_step_contact),
        max_step_hold=max(HOLD * time.end, time.max_step_hold),
    )
    return replace(scene, mesh=mesh, time=steps)


@dataclass(frozen=True, repr=False)
class CoarseRecord(BriefText):
    """How coarse and refined answers of scenes differed that were computed beforehand.

    Parameters
    ----------
    scenes : int
        Number of scenes.
    made : str
        Date.
    answers : dict
        Quantity → for each scene its value on the coarser mesh, on the coarse one, and as described.
    """

    scenes: int
    made: str
    answers: Mapping[str, list[tuple[float, float, float]]]

    @classmethod
    def from_text(cls, text: str) -> CoarseRecord:
        """From the contents of a JSON file with `made` and `scenes`, a list of tables of answers."""
        read = json.loads(text)
        scenes = [each["answers"] for each in read["scenes"]]
        return cls(len(scenes), read["made"], {name: [tuple(each[name]) for each in scenes] for name in MAIN})

    def half_width(self, quantity: str, difference: float) -> float:
        """Half of an interval's width, of the logarithm of a quantity.

        It is a factor times the difference between the two coarse meshes. Differences smaller than the usual error (the root mean
        square of the record's) count as much as that: two meshes may agree by chance. The errors of the record's scenes, each
        over its own difference, are taken for a sample of a normal distribution of mean 0. The factor is the two-sided quantile of
        Student's t for one more scene, such that all of `MAIN` lie inside together with a probability of `COVERAGE` at least
        (Bonferroni).

        Parameters
        ----------
        quantity : str
            One of `MAIN`.
        difference : float
            Of the logarithms of its values on the two meshes.

        Returns
        -------
        float
        """
        rows = self.answers[quantity]
        between = [_apart(coarser, coarse) for coarser, coarse, _ in rows]
        off = [_apart(coarse, refined) for _, coarse, refined in rows]
        usual = _rms(off)
        ratios = [each / max(own, usual) for each, own in zip(off, between, strict=True)]
        outside = (1 - COVERAGE) / len(MAIN)
        factor = float(scipy.stats.t.ppf(1 - outside / 2, len(rows))) * _rms(ratios)
        return factor * max(abs(difference), usual)

    def interval(self, quantity: str, value: float, coarse: float, coarser: float) -> tuple[float, float] | None:
        """The interval in which the value of the scene as described should lie.

        Parameters
        ----------
        quantity : str
            One of `MAIN`.
        value : float
            On the coarse mesh.
        coarse, coarser : float
            Values of the protocol that is computed on both meshes, which may be another one.

        Returns
        -------
        tuple of float or None
            None where a value is not positive, so that it has no logarithm.

        Examples
        --------
        >>> record = CoarseRecord(2, "2026-01-01", {"mps_p95": [(0.98, 1.0, 1.05), (1.01, 1.0, 0.97)]})
        >>> low, high = record.interval("mps_p95", 0.2, 0.2, 0.2)
        >>> round(low, 3), round(high, 3)
        (0.155, 0.257)
        """
        if min(value, coarse, coarser) <= 0:
            return None
        half = self.half_width(quantity, _apart(coarser, coarse))
        return value * math.exp(-half), value * math.exp(half)


@cache
def shipped_record() -> CoarseRecord:
    """The record that comes with the package."""
    return CoarseRecord.from_text((resources.files(__package__) / RECORD).read_text(encoding="utf-8"))


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _apart(one: float, other: float) -> float:
    return abs(math.log(other / one))
