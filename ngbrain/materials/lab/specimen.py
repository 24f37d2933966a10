"""Many copies of one material in one test, each at its own stretch: energy, nominal stress and equilibrium."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cached_property
from typing import TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import ConvergenceError, InputError
from ngbrain.materials.base import Deformation, Law, density
from ngbrain.materials.catalogue import find_entry
from ngbrain.materials.lab.modes import Mode
from ngbrain.materials.points import Points

Energy: TypeAlias = Callable[[Deformation], CoefficientFunction]
STATIONARY = 1e-9
"""Transverse forces of the symmetric state below this fraction of the largest stress count as round-off."""
NEWTON_STEPS = 80
_FIELDS = re.compile(r"coordinate|GridFunction|Voxel|DomainWise|MeshSize|NormalVector")


class Specimen:
    """n states x of one `Mode`, as one array (entries, n), with derivatives of the energy from NGSolve.

    The functions in `follow` are called after every change of state.

    Parameters
    ----------
    energy : Energy
        Deformation → energy density (Pa).
    mode : Mode
        The test.
    count : int
        Number n of states.
    name : str, default 'the material'
        Name of the material, for messages.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.materials.lab.modes import MODES
    >>> specimen = Specimen.from_law(NeoHooke(2.0), MODES["planar"], 1)
    >>> specimen.state = MODES["planar"].isotropic(np.array([2.0]))
    >>> specimen.stress
    array([3.75])
    """

    def __init__(self, energy: Energy, mode: Mode, count: int, name: str = "the material") -> None:
        self.mode, self.name = mode, name
        self.follow: list[Callable[[], None]] = []
        self.points = Points.line(count)
        self._field = self.points.field(mode.isotropic(np.full(count, mode.rest)))
        # Separate entries make x one vector variable of differentiation in every mode.
        self.x = ngs.CF(tuple(self._field[i] for i in range(self._field.dim))).MakeVariable()
        self.F = mode.deformation(self.x)
        self.C = self.F.trans * self.F
        self.at = Deformation(self.C, self.C, ngs.CF(1.0), self.F)
        self._energy = energy(self.at)

    @classmethod
    def from_law(cls, law: Law, mode: Mode, count: int) -> Specimen:
        """Specimen of an elastic law."""
        check_elastic(law)
        return cls(lambda at: density(law, at), mode, count, message_text(law))

    @property
    def state(self) -> np.ndarray:
        """x, shape (entries, n)."""
        return self._state

    @state.setter
    def state(self, x: np.ndarray) -> None:
        self._state = x
        self.points.put(self._field, x)
        for adapt in self.follow:
            adapt()

    @cached_property
    def _first(self) -> CoefficientFunction:
        return self._energy.Diff(self.x)

    @cached_property
    def _compiled(self) -> tuple[CoefficientFunction, ...]:
        return self._energy.Compile(), self._first.Compile()

    @cached_property
    def _second(self) -> CoefficientFunction:
        return self._first.Diff(self.x).Compile()

    @property
    def energy(self) -> np.ndarray:
        """W (Pa), shape (n,)."""
        return self.points(self._compiled[0])[0]

    @property
    def force(self) -> np.ndarray:
        """∂W/∂x (Pa), shape (entries, n)."""
        return np.atleast_2d(self.points(self._compiled[1]))

    @property
    def stress(self) -> np.ndarray:
        """Nominal stress (Pa), shape (n,): P₁₁, or P₁₂ in shear. As the other entries minimise the energy, it is ∂W/∂x₀."""
        return self.force[0]

    @property
    def stiffness(self) -> np.ndarray:
        """∂²W/∂x² (Pa), shape (n, entries, entries)."""
        entries = len(self._state)
        return self.points(self._second).T.reshape(-1, entries, entries)

    def deformation_gradient(self) -> tuple[np.ndarray, np.ndarray]:
        """F, shape (n, 3, 3), and ∂F/∂x, shape (n, 3, 3, entries)."""
        n, entries = len(self.points.mapped), len(self._state)
        return (
            self.points(self.F.Compile()).T.reshape(n, 3, 3),
            self.points(self.F.Diff(self.x).Compile()).T.reshape(n, 3, 3, entries),
        )

    def stretch_to(self, stretches: np.ndarray) -> None:
        """Prescribe these stretches (n,) and find equilibrium, starting from the symmetric state."""
        self.state = self.mode.isotropic(stretches)
        force = self.force
        self.check_finite_energy(stretches, self.energy + force.sum(axis=0))
        transverse = force[self.mode.given :]
        if transverse.size and np.abs(transverse).max() > STATIONARY * np.abs(force).max():
            self.find_equilibrium(self.mode.given)

    def check_finite_energy(self, stretches: np.ndarray, values: np.ndarray) -> None:
        """Raise `InputError` where values are not finite, with the admissible range of stretches.

        Parameters
        ----------
        stretches : numpy.ndarray of shape (n)
            Stretches.
        values : numpy.ndarray of shape (n)
            Energies or stresses at these.

        Raises
        ------
        InputError
            Names the stretch nearest to rest without a finite value, and the limit of admissible stretches.
        """
        bad = stretches[~np.isfinite(values)]
        if bad.size:
            worst = float(bad[np.argmin(np.abs(bad - self.mode.rest))])
            where = "stretches" if self.mode.rest else "shears"
            raise InputError(
                where, f"{worst:g}, where {self.name} has no finite energy", f"{self._limit(worst)} in {self.mode.name}"
            )

    def _limit(self, bad: float) -> str:
        low, high = self.mode.rest, bad
        n = len(self.points.mapped)
        rounds = max(1, int(np.ceil(60 / np.log2(n + 1))))
        for _ in range(rounds):
            trial = np.linspace(low, high, n + 2)[1:-1]
            self.state = self.mode.isotropic(trial)
            finite = np.isfinite(self.energy)
            count = n if finite.all() else int(np.argmin(finite))
            ends = np.concatenate([[low], trial, [high]])
            low, high = float(ends[count]), float(ends[count + 1])
        if abs(low - self.mode.rest) < 1e-9:
            return "a law with a finite energy near rest"
        return f"{'less' if bad > self.mode.rest else 'more'} than {low:.6g}"

    def find_equilibrium(self, first: int, load: np.ndarray | float = 0.0) -> None:
        """Minimise the energy W - load (x₀ + … of the prescribed entries) over the entries of x from `first` on.

        Newton's method at all points at once, with the absolute Hessian and a line search at each point, from the
        present `state`. Stretches stay positive.

        Parameters
        ----------
        first : int
            First free entry of x.
        load : numpy.ndarray or float, default 0.0
            Nominal stress (Pa) on the prescribed entries.

        Raises
        ------
        ConvergenceError
            Newton's method does not converge.
        """
        last = np.inf
        for _ in range(NEWTON_STEPS):
            x, slope, curvature = self.state, self._pull(load)[first:], self.stiffness[:, first:, first:]
            if not (np.isfinite(slope).all() and np.isfinite(curvature).all()):
                break
            values, vectors = np.linalg.eigh(curvature)
            size = np.maximum(np.abs(values), 1e-12 * np.abs(values).max(axis=1, keepdims=True) + 1e-300)
            step = np.zeros_like(x)
            along = np.einsum("nij,in->nj", vectors, slope) / size
            step[first:] = -np.einsum("nij,nj->in", vectors, along)
            moved = np.max(np.abs(step) / (1 + np.abs(x)))
            done = moved <= 1e-9 or (moved <= 1e-5 and moved > last / 2)  # or as small as round-off permits
            last = moved
            self._advance(step, load, np.einsum("in,in->n", slope, step[first:]), size.max(axis=1))
            if done:
                return
        raise ConvergenceError(
            f"{self.name} found no equilibrium in {self.mode.name} at stretch {self.state[0, self._worst(load, first)]:g}; "
            "try smaller stretches or shorter steps"
        )

    def _worst(self, load: np.ndarray | float, first: int) -> int:
        pull = np.abs(self._pull(load)[first:]).max(axis=0)
        return int(np.argmax(np.where(np.isfinite(pull), pull, np.inf)))

    def _pull(self, load: np.ndarray | float) -> np.ndarray:
        force = self.force
        force[: self.mode.given] -= load
        return force

    def _potential(self, load: np.ndarray | float) -> np.ndarray:
        return self.energy - load * self._state[: self.mode.given].sum(axis=0)

    def _advance(self, step: np.ndarray, load: np.ndarray | float, slope: np.ndarray, stiff: np.ndarray) -> None:
        """Line search along `step` at each point (Armijo)."""
        x, before, length = self.state, self._potential(load), np.ones(step.shape[1])
        slack = 1e-14 * (np.abs(before) + stiff)
        for _ in range(50):
            self.state = x + length * step
            with np.errstate(invalid="ignore"):
                well = self._potential(load) <= before + 1e-4 * length * slope + slack
            if self.mode.rest:
                well &= (self.state[: self.mode.given] > 0).all(axis=0)
            if well.all():
                return
            length = np.where(well, length, length / 2)


def check_elastic(law: Law) -> None:
    """Raise `InputError` unless `law` is elastic and without parameters that vary in space."""
    if hasattr(law, "branches"):
        raise InputError("law", type(law).__name__, "an elastic one: material.equilibrium or material.instantaneous")
    if not isinstance(law, Law):
        raise InputError("law", repr(law), "an object with energy(C)")
    check_homogeneous(law)


def warn_beyond(material: object, mode: Mode, stretches: np.ndarray) -> None:
    """Warn, once per entry, if a material of the catalogue leaves the stretches of its data; a shear γ counts as 1 ± γ/2.

    Parameters
    ----------
    material : object
        Material in the test.
    mode : Mode
        The test.
    stretches : numpy.ndarray
        Stretches of the test.
    """
    if entry := find_entry(material):
        met = stretches if mode.rest else 1 + np.outer([-0.5, 0.5], stretches.ravel())
        entry.check(float(met.min()), float(met.max()))


def check_homogeneous(law: Law) -> None:
    """Raise `InputError` for parameters that vary in space."""
    found = _FIELDS.search(str(density(law, Deformation(ngs.Id(3), ngs.Id(3), ngs.CF(1.0), ngs.Id(3)))))
    if found:
        raise InputError(
            "law", f"{type(law).__name__} with a parameter that varies in space", "numbers or ngsolve Parameters"
        )


def message_text(law: object) -> str:
    """Text of a law for messages."""
    text = repr(law)
    return text if len(text) < 100 and " object at " not in text else type(law).__name__
