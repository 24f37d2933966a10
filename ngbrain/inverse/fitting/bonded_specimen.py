"""Material parameters from tests of specimens glued to their plates, as soft tissue is, by the full field of each specimen.

    P = F/A,  F the force on the upper plate and A the glued area, of a body in equilibrium under each deformation

A glued specimen cannot widen at its ends in compression, and its free sides do not shear. Fits that assume homogeneous deformation
(`materials.lab.fit`) attribute this to the parameters.

References
----------
Tests: Budday et al. 2017, 10.1016/j.actbio.2016.10.036.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Force
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticLinearisation, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials.base import Law
from ngbrain.materials.lab.curves import Curve, check_curves
from ngbrain.materials.lab.fit import Bounds, CurveFit, Fit
from ngbrain.materials.lab.modes import find_mode
from ngbrain.materials.points import initial_modulus
from ngbrain.materials.viscous import Viscous
from ngbrain.mesh import block

Array = np.ndarray
MOTIONS = {"uniaxial": (0.0, 0.0, 1.0), "shear": (1.0, 0.0, 0.0)}
"""Direction of the upper plate, by test."""
STIFF = 1e4
"""K/μ of a specimen without a given bulk modulus, with the initial guess of μ; a tenth of it changes stresses by 0.7 %."""


@dataclass(frozen=True)
class BondedSpecimen:
    """Block between two plates that it is glued to.

    Parameters
    ----------
    size : tuple of float
        Edge lengths along x, y, z (m). The plates are at the ends of z; one moves along z ("uniaxial") or x ("shear").
    bulk : float, optional
        Bulk modulus K (Pa). Default 10 000 times the initial shear modulus.
    maxh : float, optional
        Element size (m). Default a third of the shortest edge.
    form : str
        Element, as for `Problem`.
    levels : int
        Deformations that are computed for each curve on each side of rest; a polynomial through rest interpolates.

    Raises
    ------
    InputError
        If an edge length or the number of levels is not positive.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke, lab
    >>> cube, law = BondedSpecimen((0.005, 0.005, 0.005), maxh=0.005, levels=1), NeoHooke(1000.0)
    >>> bool(cube.stress(law, "uniaxial", [0.9])[0] < lab.stress(law, "uniaxial", [0.9])[0])  # stiffer in compression
    True
    """

    size: tuple[float, float, float] = (0.005, 0.005, 0.005)
    bulk: float | None = None
    maxh: float | None = None
    form: str = "P3/P2"
    levels: int = 5

    def __post_init__(self) -> None:
        if len(self.size) != 3 or not all(edge > 0 for edge in self.size):
            raise InputError("BondedSpecimen.size", self.size, "three lengths in m")
        if not self.levels >= 1:
            raise InputError("BondedSpecimen.levels", self.levels, "at least 1")

    def stress(self, law: Law, mode: str, stretches: object) -> Array:
        """Nominal stress of the specimen, as `lab.stress` gives it for a homogeneous body.

        Parameters
        ----------
        law : Law
            Constitutive law.
        mode : str
            "uniaxial" or "shear".
        stretches : array-like (n,)
            Stretches λ or shears γ.

        Returns
        -------
        array (n,)
            Nominal stress (Pa).
        """
        where = find_mode(mode).check_stretches(stretches)
        bodies, matrix = self._tests(mode, where, Material(law, self._bulk(law)))
        for body in bodies:
            LoadPath(body).solve()
        return matrix @ np.array([body.force("top") @ MOTIONS[mode] for body in bodies])

    def fit(
        self,
        law: Callable[..., Law],
        data: Iterable[Curve],
        start: Mapping[str, float],
        bounds: Mapping[str, Bounds] | None = None,
        starts: int = 1,
        weights: Mapping[str, float] | None = None,
        seed: int = 0,
    ) -> Fit:
        """Fit a law to elastic curves of uniaxial tests and shear, as `lab.fit`, with exact derivatives.

        Start from the result of `lab.fit`. The intervals do not account for the mesh: by default stresses are about 1 % too high.

        Parameters
        ----------
        law : callable
            Constructor of the law, which takes ngsolve `Parameter` objects.
        data : iterable of Curve
            Measured curves.
        start : mapping of str to float
            Initial guess of the parameters.
        bounds : mapping of str to Bounds, optional
            Bounds of the parameters.
        starts : int
            Number of initial guesses.
        weights : mapping of str to float, optional
            Weights of the curves.
        seed : int
            Seed of the random initial guesses.

        Returns
        -------
        Fit

        Raises
        ------
        InputError
            For curves with times, and for other tests.
        """
        return BondedFit(self, law, check_curves(data), dict(start), bounds or {}, weights or {}).best(starts, seed)

    def _bulk(self, law: Law) -> float:
        return STIFF * float(initial_modulus(law)) if self.bulk is None else self.bulk

    def _tests(self, mode: str, stretches: Array, material: Material) -> tuple[list[Problem], Array]:
        """Problems of one test, and the matrix from their forces (N) to nominal stresses (Pa) at all stretches."""
        if mode not in MOTIONS:
            raise InputError("mode", repr(mode), f"a test between plates: {' or '.join(MOTIONS)}")
        mesh = block(self.size, self.maxh or min(self.size) / 3)
        levels, parts = _levels(stretches - find_mode(mode).rest, self.levels)
        ways = (tuple(float(e) * self.size[2] * along for along in MOTIONS[mode]) for e in levels)
        bodies = [Problem(mesh, {".*": material}, {"bottom": 0, "top": way}, element=self.form) for way in ways]
        return bodies, parts / (self.size[0] * self.size[1])


def _levels(strains: Array, most: int) -> tuple[Array, Array]:
    """Deformations to compute, and the interpolation matrix from values there to values at all strains; zero at rest."""
    levels, columns = [], []
    for side in (-1, 1):
        mine = side * strains > 0
        if not mine.any():
            continue
        at = np.unique(strains[mine])
        end = at[np.argmax(np.abs(at))]
        if len(at) > most:
            at = end * (1 - np.cos(np.pi * np.arange(1, most + 1) / most)) / 2
        part = np.zeros((len(strains), len(at)))
        part[mine] = _powers(strains[mine] / end, len(at)) @ np.linalg.inv(_powers(at / end, len(at)))
        levels.append(at)
        columns.append(part)
    return np.concatenate(levels), np.hstack(columns)


def _powers(x: Array, most: int) -> Array:
    return x[:, None] ** np.arange(1, most + 1)


class BondedFit(CurveFit):
    """Curve fit with bonded specimens in place of homogeneous ones; `model` contains all specimens.

    Parameters
    ----------
    plates : BondedSpecimen
        Specimen.
    law : callable
        Constructor of the law.
    curves : list of Curve
        Measured curves.
    start : dict of str to float
        Initial guess of the parameters.
    bounds : mapping of str to Bounds
        Bounds of the parameters.
    weights : mapping of str to float
        Weights of the curves.

    Raises
    ------
    InputError
        If a curve has times or no deformation, or the law is viscoelastic.
    """

    ends: Mapping[str, float] = {"xtol": 1e-6, "ftol": 1e-9, "gtol": 1e-9}

    def __init__(
        self,
        plates: BondedSpecimen,
        law: Callable[..., Law],
        curves: list[Curve],
        start: dict[str, float],
        bounds: Mapping[str, Bounds],
        weights: Mapping[str, float],
    ) -> None:
        for curve in curves:
            if curve.times is not None:
                raise InputError(f"data[{curve.label!r}].times", "given", "an elastic curve, without times")
            if not np.any(curve.stretches != find_mode(curve.mode).rest):
                raise InputError(f"data[{curve.label!r}].stretches", "all at rest", "some that deform")
        self._plates = plates
        super().__init__(law, curves, start, bounds, weights)

    def prepare(self) -> None:
        """Build one static model of all specimens."""
        law = self.law(**{name: parameter.Get() for name, parameter in self.parameters.items()})
        if isinstance(law, Viscous):
            raise InputError("law", "a viscoelastic one", "an elastic one")
        material = Material(self.law(**self.parameters), self._plates._bulk(law))
        tests = [self._plates._tests(curve.mode, curve.stretches, material) for curve in self.curves]
        observables = [Force("top", motions=(MOTIONS[curve.mode],)) for curve in self.curves]
        cases = [
            LoadCase(body, [force]) for (bodies, _), force in zip(tests, observables, strict=True) for body in bodies
        ]
        self.model = StaticModel(cases, self.parameters)
        self._matrices = [matrix for _, matrix in tests]
        ends = np.cumsum([0, *(matrix.shape[1] for matrix in self._matrices)])
        self._places = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self._last: StaticLinearisation | None = None

    def stresses(self, values: Mapping[str, float]) -> list[Array]:
        """Nominal stress (Pa) along each curve."""
        self.law(**values)  # the law checks its parameters
        return self._along(self._at(np.array(list(values.values()), float)).data)

    def gradient(self, x: Array) -> Array:
        """Derivative of the residuals (data, parameters)."""
        there = self._at(x)
        return np.array([self.scale_stresses(self._along(there.jvp(unit))) for unit in np.eye(len(x))]).T

    def _at(self, x: Array) -> StaticLinearisation:
        if self._last is None or not np.array_equal(self._last.theta, x):
            self._last = self.model.evaluate(x)
        return self._last

    def _along(self, forces: Array) -> list[Array]:
        return [matrix @ forces[where] for matrix, where in zip(self._matrices, self._places, strict=True)]
