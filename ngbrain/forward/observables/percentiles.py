"""Percentiles of strain and stress over a region."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import quadrature_points
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables.base import Observable, ProblemObservable, SymbolicObservable
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import FieldState, Motion, StateView, Terms
from ngbrain.look import BriefText
from ngbrain.materials.base import Deformation, check_parameter
from ngbrain.tensors import octahedral_shear

Array = np.ndarray
ORDER = 2
"""Order of the quadrature whose points enter a percentile: that of squared strains of elements of order 2."""
MEASURES = ("Green-Lagrange", "small", "octahedral")
EQUAL = 1e-9
"""Difference below which two principal strains count as equal, relative to the largest."""
LEAST = 1e-10
"""Octahedral shear strain below which its derivative counts as zero: a square root has none at 0."""
STILL = 1e-8
"""Stress below which its derivative counts as zero, relative to the shear modulus."""


@dataclass(frozen=True, repr=False)
class RegionPercentile(BriefText, Observable):
    """A percentile of a scalar field over a region, by reference volume.

    A single percentile has no gradient. The value is therefore a mean of the percentiles in a band, with weights
    3/4 (1 - s²), s from -1 to 1 across the band; `ProblemPercentile.raw` is the percentile without this smoothing. First and
    second derivatives are those at fixed ranks of the points; a change of many ranks is not included.

    Parameters
    ----------
    percent : float
        0 to 100.
    region : str
        A pattern.
    centre : sequence of float, optional
        Reference position (m) of a point; with `within` only the neighbourhood of that point counts.
    within : float, optional
        Radius (m) of that neighbourhood.
    where : CoefficientFunction, optional
        Function of the reference position: above 1/2 where the region counts.
    band : float
        Half width of the band, as a fraction of the volume, 0.001 to 0.5; closer to 0 or 100 % the band ends there.

    Raises
    ------
    InputError
        For values out of range; when evaluated on a problem, for a region and radius that contain none of it.

    References
    ----------
    L-estimators: Serfling 1980, Approximation Theorems of Mathematical Statistics, 8.1, 10.1002/9780470316481.
    """

    percent: float
    region: str = ".*"
    centre: Sequence[float] | None = None
    within: float | None = None
    band: float = 0.05
    where: ngs.CoefficientFunction | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        check_parameter(self.percent, "percent", lambda p: 0 <= p <= 100, "0 to 100")
        check_parameter(self.band, "band", lambda b: 0.001 <= b <= 0.5, "0.001 to 0.5 of the volume")
        if (self.centre is None) != (self.within is None):
            raise InputError("within", self.within, "a distance (m) and a centre, or neither")

    def _named(self, what: str) -> str:
        near = "" if self.within is None else f" within {1e3 * self.within:g} mm of a point"
        return f"{self.percent:g} % percentile of the {what} in {self.region}{near}"


@dataclass(frozen=True)
class StrainPercentile(RegionPercentile):
    """A percentile of the largest principal strain, or of the octahedral shear strain, see `RegionPercentile`.

    Parameters
    ----------
    measure : str
        The largest principal strain of "Green-Lagrange" (FᵀF - 1)/2, or of "small", the symmetric part of ∇u; or "octahedral", the
        octahedral shear strain of the logarithmic strain (`tensors.octahedral_shear`).
    factor : float
        Factor of the displacements.
    """

    measure: str = "Green-Lagrange"
    factor: float = 1.0
    unit = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.measure not in MEASURES:
            raise InputError("measure", repr(self.measure), " or ".join(map(repr, MEASURES)))

    @property
    def name(self) -> str:
        """Name for reports."""
        octahedral = self.measure == "octahedral"
        return self._named("octahedral shear strain" if octahedral else f"largest {self.measure} strain")

    def on(self, problem: Problem) -> ProblemStrainPercentile:
        """At quadrature points of order 2."""
        return ProblemStrainPercentile(problem, self)


@dataclass(frozen=True)
class StressPercentile(RegionPercentile):
    """A percentile of von Mises' stress √(3/2 dev σ : dev σ) (Pa), σ the Cauchy stress, see `RegionPercentile`.

    Raises
    ------
    InputError
        When evaluated on a problem with viscoelastic tissue, whose stress depends on its history.
    """

    unit = "Pa"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("von Mises stress")

    def on(self, problem: Problem) -> ProblemStressPercentile:
        """At quadrature points of order 2."""
        return ProblemStressPercentile(problem, self)


def weighted_percentile(values: Array, weights: Array, percent: float) -> float:
    """Weighted percentile, interpolated between values.

    Parameters
    ----------
    values, weights : array (n,)
    percent : float
        0 to 100.

    Returns
    -------
    float

    Examples
    --------
    >>> weighted_percentile(np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 2.0]), 50)
    2.0
    """
    order = np.argsort(values)
    weights = weights[order]
    share = np.cumsum(weights)
    return float(np.interp(percent / 100 * share[-1], share - weights / 2, values[order]))


class ProblemPercentile(ProblemObservable):
    """A `RegionPercentile` of one problem.

    Parameters
    ----------
    problem : Problem
    asked : RegionPercentile

    Raises
    ------
    InputError
        For a region and radius without points of the body.
    """

    size, has_shape_derivative = 1, False

    def __init__(self, problem: Problem, asked: RegionPercentile) -> None:
        super().__init__(problem)
        self._of, mesh = asked, problem.mesh
        self._space, points = quadrature_points(mesh, ORDER)
        inside = ngs.GridFunction(self._space)
        region = mesh.MaterialCF({asked.region: 1.0}, default=0.0)
        inside.Interpolate(region if asked.where is None else region * asked.where)
        volumes = self._volumes() * (inside.vec.FV().NumPy() > 0.5)
        if asked.within is not None:
            volumes *= np.linalg.norm(points - np.asarray(asked.centre, float), axis=1) <= asked.within
        if not volumes.any():
            raise InputError("region", repr(asked.region), "a region and a radius that contain some of the body")
        self._counted = np.flatnonzero(volumes)
        self._shares = volumes[self._counted] / volumes.sum()

    def _volumes(self) -> Array:
        """Volume that each point represents (m³; in plane strain m²)."""
        v = self._space.TestFunction()
        form = ngs.LinearForm(self._space)
        form += self.problem.kinematics.weight() * v * ngs.dx(intrules=self._space.GetIntegrationRules())
        form.Assemble()
        return np.array(form.vec.FV().NumPy())

    @abstractmethod
    def values(self) -> Array:
        """Value of the field at each point of the region."""

    def value(self) -> Array:
        """The mean over the band (1,)."""
        values = self.values()
        return np.array([self._weights(values) @ values])

    @property
    def raw(self) -> float:
        """The percentile without smoothing, interpolated between points."""
        return weighted_percentile(self.values(), self._shares, self._of.percent)

    def _weights(self, values: Array) -> Array:
        """Weight of each point: the integral of the kernel over its ranks."""
        order, band = np.argsort(values, kind="stable"), self._of.band
        ends = np.concatenate([[0.0], np.cumsum(self._shares[order])])
        middle = np.clip(self._of.percent / 100, band, 1 - band)
        s = np.clip((ends / ends[-1] - middle) / band, -1, 1)
        found = np.empty(len(values))
        found[order] = np.diff((3 * s - s**3) / 4)
        return found

    def _spread(self, field: ngs.GridFunction, weights: Array, values: Array) -> None:
        """Set the density of each point's share in a weighted percentile."""
        entries = field.vec.FV().NumPy()
        entries[:] = 0.0
        # From shares to densities: divide by the volume that a point represents.
        entries[self._counted] = weights[0] * self._weights(values) / self._volumes_here

    @cached_property
    def _volumes_here(self) -> Array:
        return self._volumes()[self._counted]


class ProblemStrainPercentile(SymbolicObservable, ProblemPercentile):
    """A `StrainPercentile` of one problem.

    Around the current state, with principal axes n, m and strains e, the principal strain of E along n is, to second order in
    E, n·En + Σ (n·Em)²/(e_n - e_m).

    Parameters
    ----------
    problem : Problem
    asked : StrainPercentile
    """

    def __init__(self, problem: Problem, asked: StrainPercentile) -> None:
        super().__init__(problem, asked)
        self.asked = asked
        gradient = problem.kinematics.gradient(problem.u, ngs.Grad(problem.u))
        self._gradient, self._F = gradient.Compile(), ngs.GridFunction(ngs.MatrixValued(self._space, 3))
        self._share, self._apart = ngs.GridFunction(self._space), ngs.GridFunction(ngs.VectorValued(self._space, 3))
        self._axes, self._view = ngs.GridFunction(ngs.MatrixValued(self._space, 3)), StateView(problem)

    def strains(self) -> tuple[Array, Array, Array]:
        """Principal strains at each point of the region, the largest last, their directions (columns) and F."""
        self._F.Interpolate(self._gradient)
        change = self._F.vec.FV().NumPy().reshape(9, -1)[:, self._counted].T.reshape(-1, 3, 3) - np.eye(3)
        F = np.eye(3) + self.asked.factor * change
        small = self.asked.measure == "small"
        E = (F + F.transpose(0, 2, 1)) / 2 - np.eye(3) if small else (F.transpose(0, 2, 1) @ F - np.eye(3)) / 2
        values, directions = np.linalg.eigh(E)
        return values, directions, F

    def values(self) -> Array:
        """The largest principal strains, or octahedral ones."""
        return self._of_principal(self.strains()[0])

    def _of_principal(self, values: Array) -> Array:
        return octahedral_shear(np.log(1 + 2 * values) / 2) if self.asked.measure == "octahedral" else values[:, -1]

    def set_weights(self, weights: Array) -> None:
        """Set the weights at the points' current ranks, so that only the strains are differentiated."""
        if not weights.any():
            self._share.vec[:] = 0.0
            return
        values, directions, _ = self.strains()
        self._spread(self._share, weights, self._of_principal(values))
        self._axes.vec.FV().NumPy().reshape(9, -1)[:, self._counted] = directions.reshape(-1, 9).T
        apart = values[:, [2, 2, 1]] - values[:, [0, 1, 0]]
        # Equal strains have first derivatives along either axis, and no second ones.
        least = EQUAL * np.abs(values).max(axis=1, keepdims=True)
        self._apart.vec.FV().NumPy().reshape(3, -1)[:, self._counted] = np.divide(
            1.0, apart, out=np.zeros_like(apart), where=apart > least
        ).T

    def _weighed(self, at: FieldState) -> ngs.comp.SumOfIntegrals:
        """Strains, each weighted by its point's share."""
        change = self.asked.factor * (at.F - ngs.Id(3))
        E = (change + change.trans) / 2
        if self.asked.measure != "small":
            E = E + change.trans * change / 2
        axes, pairs = [self._axes[:, i] for i in range(3)], {(2, 0): 0, (2, 1): 1, (1, 0): 2}
        principal = [ngs.InnerProduct(axis, E * axis) for axis in axes]
        for (upper, lower), i in pairs.items():
            more = self._apart[i] * ngs.InnerProduct(axes[lower], E * axes[upper]) ** 2
            principal[upper], principal[lower] = principal[upper] + more, principal[lower] - more
        if self.asked.measure == "octahedral":
            one, two, three = (ngs.log(1 + 2 * each) / 2 for each in principal)
            strain = 2 / 3 * ngs.sqrt((one - two) ** 2 + (two - three) ** 2 + (three - one) ** 2 + LEAST**2)
        else:
            strain = principal[2]
        rules = self._space.GetIntegrationRules()
        return at.kinematics.weight() * self._share * strain * ngs.dx(intrules=rules)

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """The weighted percentile as an integral."""
        return self._view.functional(self._weighed, state, *along)


class ProblemStressPercentile(SymbolicObservable, ProblemPercentile):
    """A `StressPercentile` of one problem.

    Parameters
    ----------
    problem : Problem
    asked : StressPercentile

    Raises
    ------
    InputError
        For viscoelastic tissue.
    """

    def __init__(self, problem: Problem, asked: StressPercentile) -> None:
        super().__init__(problem, asked)
        if any(material.viscous.branches for material in problem.materials.values()):
            raise InputError("materials", "viscoelastic tissue", "elastic tissue, for a percentile of stress")
        self._share, self._stress = ngs.GridFunction(self._space), ngs.GridFunction(self._space)
        self._view = StateView(problem)
        (now,) = self._view.functional(self._weighed, problem.gfu)
        self._now = now.coef.Compile()

    def _weighed(self, at: FieldState) -> ngs.comp.SumOfIntegrals:
        """Stresses, each weighted by its point's share."""
        stress = self.problem.mesh.MaterialCF(
            {pattern: self._von_mises(material, at) for pattern, material in self.problem.materials.items()}
        )
        rules = self._space.GetIntegrationRules()
        return at.kinematics.weight() * self._share * stress * ngs.dx(intrules=rules)

    def _von_mises(self, material: Material, at: FieldState) -> ngs.CoefficientFunction:
        F = at.F.MakeVariable()
        nominal = material.energy(Deformation.from_gradient(F), at.p, at.factor).Diff(F)
        stress = nominal * F.trans / ngs.Det(F)
        deviator = stress - ngs.Trace(stress) / 3 * ngs.Id(3)
        least = (STILL * self.problem.modulus) ** 2  # a square root has no derivative at 0
        return ngs.sqrt(1.5 * ngs.InnerProduct(deviator, deviator) + least)

    def values(self) -> Array:
        """Von Mises' stresses (Pa)."""
        self._share.vec[:] = 1.0
        self._stress.Interpolate(self._now / self.problem.kinematics.weight())
        return np.array(self._stress.vec.FV().NumPy()[self._counted])

    def set_weights(self, weights: Array) -> None:
        """Set the weights at the points' current ranks, so that only the stresses are differentiated."""
        if not weights.any():
            self._share.vec[:] = 0.0
            return
        self._spread(self._share, weights, self.values())

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """The weighted percentile as an integral, also for derivatives with respect to parameters of the law."""
        return self._view.functional(self._weighed, state, *along)
