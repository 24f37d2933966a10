"""Finite viscoelasticity: Maxwell branches with a spring of any isotropic law and a viscous dashpot.

The internal variable of a branch is C_v. Its spring is strained by the elastic part of the isochoric deformation,
F_e = F̄ F_v⁻¹, through an isotropic law W(C_e); its dashpot flows with the overstress, τ = 2η D_v. With C_v⁻¹ = GGᵀ
at the start of a step, the elastic logarithmic strains before the flow of the step are x_i = ½ ln (eigenvalues of
GᵀC̄G), traceless. After it they are the e that minimises

    W(e) + κ |x - e|² ,     κ of the order of 2η/Δt ,

so a step is again a minimisation, with the stress 2κ(x - e) = ∂W/∂e. Backward Euler, κ = η/Δt, is of first order.
Here G is first relaxed over half of the step with the stress at its start, and κ is that of half a step. Both have
factors that make a branch of constant modulus exact for ramps of any length, as the hereditary one is: with y =
μΔt/η, 2μ = |∂W|²/(e·∂W),

    e ← e - θ Δt/4η ∂W/∂e ,  θ = 2/y (1 - y/(exp y - 1)) ;     κ = η/Δt · y β/(1 - β) ,  β = (1 - exp(-y))/y .

The scheme is otherwise of second order and stable for any Δt; Δt → 0 gives W, Δt → ∞ gives no stress. Unlike that
of a hereditary branch its free energy is a function of state, so every step dissipates.

References
----------
Reese & Govindjee 1998, 10.1016/S0020-7683(97)00217-5; as a minimum: Ortiz & Stainier 1999,
10.1016/S0045-7825(98)00219-9; Fancello, Ponthot & Stainier 2006, 10.1002/nme.1525.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Law, LawCard, Value, check_positive, density_of_log_strains
from ngbrain.materials.points import EVERYWHERE, Points, initial_modulus, isotropic, number, varies
from ngbrain.tensors import from_voigt, principal_values, to_voigt

PLANE = np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2], [6]])
"""Orthonormal basis of the traceless strains; the coordinates of a strain are PLANE @ (e₁, e₂, e₃)."""
ENTRIES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Index pairs of a symmetric tensor in Voigt order."""
REST = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
HALF = np.array([[1.0], [1.0], [1.0], [0.5], [0.5], [0.5]])
"""Factors from a derivative by the six Voigt entries to a derivative by the tensor, which contains each shear twice."""
UPPER = np.triu_indices(6)
SHORT = 1e-7
"""Newton steps of elastic strain below this size are the last: the error is then of the order of its square."""
ITERATIONS = 60
HALVINGS = 10
SMALL = 1e-5
"""Elastic strain below which a branch has its initial modulus: near rest the eigenvalue formula is accurate to 1e-6."""
SUDDEN = 1e-12
"""Duration of a sudden change, in relaxation times."""


@dataclass(frozen=True, repr=False)
class Maxwell(LawCard):
    """Maxwell branch: a spring (isotropic law W) and a dashpot in series.

    Parameters
    ----------
    law : Law
        Law of the spring, isotropic.
    eta : float or CoefficientFunction
        Viscosity η (Pa s), positive.

    Raises
    ------
    InputError
        A law with fibres, or a viscosity that is not positive.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke, Viscous
    >>> tissue = Viscous(NeoHooke(160.0), (Maxwell(NeoHooke(970.0), eta=2190.0),))
    """

    law: Law
    eta: Value

    def __post_init__(self) -> None:
        check_positive(self.eta, "Maxwell.eta")
        if not varies(self.law) and not isotropic(self.law):
            raise InputError("Maxwell.law", self.law, "an isotropic law; fibres belong in the equilibrium law")

    @property
    def tau(self) -> Value:
        """Relaxation time η/μ₀ (s) at small strain."""
        return self.eta / initial_modulus(self.law)

    def slopes(self, strain: CoefficientFunction) -> CoefficientFunction:
        """W, ∂W (2 entries) and ∂²W (11, 12, 22) at elastic strains given by their two coordinates (see `PLANE`)."""
        first, second = ((1.0 * strain[i]).MakeVariable() for i in range(2))
        logs = [float(PLANE[0, i]) * first + float(PLANE[1, i]) * second for i in range(3)]
        W = density_of_log_strains(self.law, logs)
        by = W.Diff(first), W.Diff(second)
        return ngs.CF((W, *by, by[0].Diff(first), by[0].Diff(second), by[1].Diff(second))).Compile()

    def overstress(self, points: Points, C: CoefficientFunction, times: np.ndarray) -> np.ndarray:
        """Overstress 2 ∂W/∂C̄ under given histories of C̄; the first value is applied suddenly.

        Parameters
        ----------
        points : Points
            Evaluation points.
        C : CoefficientFunction
            C̄, with its values at `points`: one history after the other.
        times : numpy.ndarray of shape (times)
            Times (s).

        Returns
        -------
        numpy.ndarray of shape (histories, times, 3, 3)
            Overstress (Pa).
        """
        histories = points(to_voigt(C)).reshape(6, -1, len(times))
        variables = MaxwellVariables(Points.line(histories.shape[1]), self.slopes, number(self.eta))
        answer = np.empty((*histories.shape[1:], 3, 3))
        before = np.outer(REST, np.ones(histories.shape[1]))
        for n, dt in enumerate(np.diff(times, prepend=times[0] - SUDDEN * number(self.tau))):
            variables.begin(dt, before)
            before = histories[:, :, n]
            variables.relax(before)
            answer[:, n] = tensors(variables.stress)
            variables.finish(before)
        return answer


class MaxwellVariables:
    """Internal variables of a Maxwell branch at n points, and their update in a time step.

    Tensors C̄ are arrays of their Voigt entries (6, n). After `relax`, `energy` (n,) is the minimum of W + κ|x -
    e|² and `stress` (6, n) is 2 ∂/∂C̄ of it, in Pa. Both belong to the given step, so that they are a potential and
    its derivative.

    Parameters
    ----------
    points : Points
        Evaluation points.
    slopes : callable
        Elastic strain → `Maxwell.slopes` there.
    eta : float or numpy.ndarray
        Viscosity η (n,) in Pa s, 0 where there is no such branch.
    """

    def __init__(
        self, points: Points, slopes: Callable[[CoefficientFunction], CoefficientFunction], eta: float | np.ndarray
    ) -> None:
        n = len(points.mapped)
        self.points = points
        self._strain = points.field(np.zeros((2, n)))
        self._slopes = slopes(self._strain)
        self.reset(eta)
        self._pulled = points.field(np.outer(REST, np.ones(n)))
        a = ngs.CF(tuple(self._pulled[i] for i in range(6))).MakeVariable()
        stretches = principal_values(from_voigt(a))
        logs = [ngs.log(value) / 2 for value in stretches]
        x = ngs.CF(tuple(sum(float(row[i]) * logs[i] for i in range(3)) for row in PLANE))
        by_a = x.Diff(a)
        self._spectrum = ngs.CF((x, *(value.Diff(a) for value in stretches))).Compile()
        self._first = ngs.CF((x, by_a.Reshape((12,)))).Compile()
        self._second = by_a.Diff(a).Reshape((72,)).Compile()

    def reset(self, eta: float | np.ndarray) -> None:
        """Reset the internal variables to rest, with this viscosity (Pa s) and the present parameters of the law."""
        n = len(self.points.mapped)
        self.eta = np.broadcast_to(np.asarray(eta, float), (n,))
        self.kappa = np.zeros(n)
        self.G = self._step = np.tile(np.eye(3), (n, 1, 1))
        self._pull = _congruence(self._step)
        self.energy, self.stress = np.zeros(n), np.zeros((6, n))
        self._axes = np.zeros((3, n, 3, 3))
        self._elastic, self._start, self._accepted_fraction = np.zeros((2, n)), np.zeros((2, n)), np.ones(n)
        self._modulus = self._at(self._elastic)[3] / 2

    def begin(self, dt: float, shapes: np.ndarray) -> None:
        """Start a time step: relax over its first half with the stress at the start.

        Parameters
        ----------
        dt : float
            Time step (s).
        shapes : numpy.ndarray of shape (6, n)
            C̄ at the start of the step.
        """
        self._begin(dt, *self._strained(_congruence(self.G), shapes))

    def _begin(self, dt: float, axes: np.ndarray, e: np.ndarray) -> None:
        """`begin`, from the axes of GᵀC̄G and the elastic strains e."""
        self._axes, self._start = axes, e
        slope = self._at(e)[1:3]
        squared, along = np.sum(slope * slope, axis=0), np.sum(e * slope, axis=0)
        strained = (np.sum(e * e, axis=0) > SMALL**2) & (along > 0)  # at rest both are round-off errors
        modulus = np.where(strained, squared / (2 * np.where(strained, along, 1.0)), self._modulus)
        safe = np.where(self.eta > 0, self.eta, 1.0)
        theta, factor = half_step_factors(dt * modulus / safe)
        self.kappa = self.eta / dt * factor
        viscous_strain, self._accepted_fraction = -theta * dt / (4 * safe) * slope, np.ones_like(theta)
        for _ in range(HALVINGS):  # where W still decreases at its end, the flow dissipates
            uphill = np.sum(self._at(e + viscous_strain)[1:3] * slope, axis=0) < 0
            if not np.any(uphill):
                break
            viscous_strain, self._accepted_fraction = (
                np.where(uphill, viscous_strain / 2, viscous_strain),
                np.where(uphill, self._accepted_fraction / 2, self._accepted_fraction),
            )
        self._elastic = e + viscous_strain
        self._set(self.G @ _stretched(axes, viscous_strain))

    def resume_step(self, begun: np.ndarray, start: np.ndarray) -> None:
        """Restore a step after its first half.

        Parameters
        ----------
        begun : numpy.ndarray of shape (10, n)
            `step_state` of that step.
        start : numpy.ndarray of shape (2, n)
            Elastic strains at its start.
        """
        self.kappa, self._start = begun[9], start
        self._set(begun[:9].T.reshape(-1, 3, 3))

    def _set(self, step: np.ndarray) -> None:
        """Set G after the first half of the step."""
        self._step, self._pull = step, _congruence(step)

    def relax(self, shapes: np.ndarray) -> None:
        """Find the minimum at these C̄ (6, n); NaN where there is none."""
        self.points.put(self._pulled, np.einsum("ijn,jn->in", self._pull, shapes))
        answer = self.points(self._first)
        x, by_a = answer[:2], answer[2:].reshape(2, 6, -1)
        e, slopes = self._minimum(x)
        self._current = x, by_a, slopes
        self.energy = slopes[0] + self.kappa * np.sum((x - e) ** 2, axis=0)
        self.stress = 2 * HALF * np.einsum("ijn,in->jn", self._pull, np.einsum("kn,kin->in", slopes[1:3], by_a))

    def stiffness(self, where: np.ndarray | slice = EVERYWHERE) -> np.ndarray:
        """∂²/∂C̄² of the energy by the six entries of C̄ (n, 6, 6), at the C̄ of the last `relax`; or at some points."""
        (_, by_a, slopes), k = self._current, 2 * self.kappa[where]
        by_a, slopes, pull = by_a[..., where], slopes[:, where], np.moveaxis(self._pull[..., where], 2, 0)
        a, b, c = slopes[3:]
        det = (a + k) * (c + k) - b * b
        M = np.array([[a * (c + k) - b * b, k * b], [k * b, c * (a + k) - b * b]]) * k / np.where(det != 0, det, 1.0)
        hessian = np.einsum("kn,kijn->nij", slopes[1:3], self.points(self._second, where).reshape(2, 6, 6, -1))
        hessian += np.einsum("kln,kin,ljn->nij", M, by_a, by_a)
        return np.swapaxes(pull, 1, 2) @ hessian @ pull

    def finish(self, shapes: np.ndarray) -> None:
        """End the step at these C̄ (6, n)."""
        self._finish(shapes)

    def _finish(self, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`finish`, which returns the axes of the new GᵀC̄G, unchanged by viscous flow, and its elastic strains."""
        axes, x = self._strained(self._pull, shapes)
        e, _ = self._minimum(x)
        self.G = self._step @ _stretched(axes, e - x)
        return axes, e

    @property
    def step_solution(self) -> np.ndarray:
        """Solution of the present step (5, n): e of the last `relax`, e at its start, and the accepted fraction of
        the first half's flow.
        """
        return np.vstack([self._elastic, self._start, self._accepted_fraction])

    @property
    def step_state(self) -> np.ndarray:
        """G after the first half of the present step, by rows, and κ (10, n)."""
        return np.vstack([self._step.reshape(-1, 9).T, self.kappa])

    def half_step_stress(self, half: float, middle: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Stress at the end of two steps of half the length; the present step is unchanged.

        Parameters
        ----------
        half : float
            Length of each of the two steps (s).
        middle, end : numpy.ndarray of shape (6, n)
            C̄ at the end of the first and of the second step.

        Returns
        -------
        numpy.ndarray of shape (6, n)
            `stress` (Pa) at the end.
        """
        twin = copy(self)  # its arrays are replaced, never modified
        twin._begin(half, self._axes, self._start)
        twin.relax(middle)
        twin._begin(half, *twin._finish(middle))
        twin.relax(end)
        self.points.put(self._pulled, np.einsum("ijn,jn->in", self._pull, end))  # the field is shared with the copy
        return twin.stress

    def _strained(self, pull: np.ndarray, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Axes n_i ⊗ n_i (3, n, 3, 3) of GᵀC̄G and its strains, with G as in `pull`, by the formula that the energy uses."""
        self.points.put(self._pulled, np.einsum("ijn,jn->in", pull, shapes))
        values = self.points(self._spectrum)
        return np.array([tensors(HALF * axis) for axis in values[2:].reshape(3, 6, -1)]), values[:2]

    def _at(self, e: np.ndarray, where: np.ndarray | slice = EVERYWHERE) -> np.ndarray:
        self.points.put(self._strain, e)
        return self.points(self._slopes, where)

    def _minimum(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The minimising e and `slopes` there, by Newton's method with backtracking until the gradient shrinks.

        A step shorter than `SHORT` is the last of a point, with slopes by Taylor's formula.
        """
        k, e = 2 * self.kappa, self._elastic.copy()
        slopes, left = self._at(e), np.arange(len(self.kappa))
        for _ in range(ITERATIONS):
            gradient = slopes[1:3, left] - k[left] * (x - e)[:, left]
            h11, h12, h22 = slopes[3, left] + k[left], slopes[4, left], slopes[5, left] + k[left]
            det = h11 * h22 - h12 * h12
            safe = np.where(det > 0, det, np.inf)
            step = -np.array([h22 * gradient[0] - h12 * gradient[1], h11 * gradient[1] - h12 * gradient[0]]) / safe
            going = self.points.share_element(left, np.max(np.abs(step), axis=0) > SHORT)
            _last(e, slopes, left[~going], step[:, ~going])
            left, step, size = left[going], step[:, going], np.sum(gradient[:, going] ** 2, axis=0)
            if not left.size:
                break
            length, tried = np.ones(left.size), e.copy()
            for _ in range(12):
                tried[:, left] = e[:, left] + length * step
                there = self._at(tried, left)
                shrunk = np.sum((there[1:3] - k[left] * (x - tried)[:, left]) ** 2, axis=0) <= size
                worse = ~shrunk & (np.max(np.abs(step), axis=0) > SHORT)  # below this size round-off decides
                if not np.any(worse):
                    break
                length = np.where(worse, length / 2, length)
            e, slopes[:, left] = tried, there
        else:
            e[:, left] = np.nan
        self._elastic = np.where(np.isfinite(e), e, 0.0)
        return e, slopes


def _last(e: np.ndarray, slopes: np.ndarray, where: np.ndarray, step: np.ndarray) -> None:
    """Take a short step at some points: W and ∂W to second order, ∂²W unchanged."""
    w, first, second, a, b, c = slopes[:, where]
    change = np.array([a * step[0] + b * step[1], b * step[0] + c * step[1]])
    slopes[0, where] = w + np.sum((np.array([first, second]) + change / 2) * step, axis=0)
    slopes[1:3, where] += change
    e[:, where] += step


class MaxwellTerm:
    """All Maxwell branches at the same points, as one term of the energy of a time step.

    The energy is the quadratic function a + b·d + ½ d·Dd of d, the six entries of C̄ minus those of the present
    state, with the value, gradient and Hessian of the sum of the branches: `relax` sets value and gradient,
    `stiffen` the Hessian. Forces and tangent are exact at the present state, and the form costs the same for any
    laws and any number of branches.

    Parameters
    ----------
    points : Points
        Evaluation points.
    branches : sequence of MaxwellVariables
        The branches.
    """

    def __init__(self, points: Points, branches: Sequence[MaxwellVariables]) -> None:
        n = len(points.mapped)
        self.points, self.branches = points, tuple(branches)
        self._stiffness = np.zeros((n, 6, 6))
        self._energy = points.field(
            np.zeros((34, n))
        )  # state, a, b, upper triangle of D: one field is cheaper than four
        self._stress = points.field(np.zeros((6, n)))

    def __bool__(self) -> bool:
        return bool(self.branches)

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """a + b·d + ½ d·Dd (Pa) of the isochoric C̄."""
        here, slope = (ngs.CF(tuple(self._energy[i] for i in part)) for part in (range(6), range(7, 13)))
        index = np.zeros((6, 6), int)
        index[UPPER] = index.T[UPPER] = np.arange(13, 34)
        D = ngs.CF(tuple(self._energy[int(i)] for i in index.ravel()), dims=(6, 6))
        d = to_voigt(C) - here
        return self._energy[6] + ngs.InnerProduct(slope + D * d / 2, d)

    def work(self, C: CoefficientFunction) -> CoefficientFunction:
        """½ S:C̄, which has the gradient of `energy` at the present state, for forces alone."""
        return 0.5 * ngs.InnerProduct(from_voigt(self._stress), C)

    def begin(self, dt: float, shapes: np.ndarray) -> None:
        """Start a time step in all branches.

        Parameters
        ----------
        dt : float
            Time step (s).
        shapes : numpy.ndarray of shape (6, n)
            C̄ at the start of the step.
        """
        for branch in self.branches:
            branch.begin(dt, shapes)

    def relax(self, shapes: np.ndarray) -> None:
        """Find the minimum of every branch at these C̄ (6, n)."""
        for branch in self.branches:
            branch.relax(shapes)
        self._shapes = shapes
        self._set()

    def stiffen(self, where: np.ndarray | slice = EVERYWHERE) -> None:
        """Set the Hessian at the C̄ of the last `relax`, everywhere or at some points, all of their elements."""
        self._stiffness[where] = np.sum([branch.stiffness(where) for branch in self.branches], axis=0)
        self._set()

    def _set(self) -> None:
        stress = np.sum([branch.stress for branch in self.branches], axis=0)
        level = np.sum([branch.energy for branch in self.branches], axis=0)
        half = self._stiffness[:, *UPPER].T
        self.points.put(self._energy, np.vstack([self._shapes, level, stress / (2 * HALF), half]))
        self.points.put(self._stress, stress)

    def finish(self, shapes: np.ndarray) -> None:
        """End the step at these C̄ (6, n)."""
        for branch in self.branches:
            branch.finish(shapes)

    @property
    def frozen(self) -> list[np.ndarray]:
        """Coefficients of the energy in the current state."""
        return [field.vec.FV().NumPy().copy() for field in (self._energy, self._stress)]

    @frozen.setter
    def frozen(self, values: list[np.ndarray]) -> None:
        """Restore these coefficients."""
        for field, value in zip((self._energy, self._stress), values, strict=True):
            field.vec.FV().NumPy()[:] = value


def tensors(entries: np.ndarray) -> np.ndarray:
    """Symmetric tensors (n, 3, 3) from their Voigt entries (6, n)."""
    return np.moveaxis(entries[np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])], 2, 0)


def _congruence(G: np.ndarray) -> np.ndarray:
    """Matrices (6, 6, n) that map the Voigt entries of C to those of GᵀCG."""
    g = np.ascontiguousarray(np.moveaxis(G, 0, 2))
    matrices = np.empty((6, 6, len(G)))
    for row, (i, j) in zip(matrices, ENTRIES, strict=True):
        for entry, (k, m) in zip(row, ENTRIES, strict=True):
            entry[:] = g[k, i] * g[m, j] if k == m else g[k, i] * g[m, j] + g[m, i] * g[k, j]
    return matrices


def half_step_factors(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """θ and κ Δt/η (see the module) of a step y = Δt/τ with the relaxation time τ of the branch; 1 and 2 at y = 0.

    >>> theta, factor = half_step_factors(np.array([0.0, 1e6]))
    >>> theta.round(5).tolist(), factor.round(5).tolist()
    ([1.0, 0.0], [2.0, 1.0])
    """
    small = y < 1e-4
    y_ = np.where(small, 1.0, y)
    shrunk = y_ * np.exp(-y_) / -np.expm1(-y_)  # y/(exp y - 1)
    beta = -np.expm1(-y_) / y_
    return np.where(small, 1 - y / 6, 2 / y_ * (1 - shrunk)), np.where(small, 2 - y / 3, y_ * beta / (1 - beta))


def _stretched(axes: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Σ exp(strain_i) n_i ⊗ n_i (n, 3, 3), of coordinates of traceless strains (2, n)."""
    return np.einsum("in,injk->njk", np.exp(PLANE.T @ strain), axes)
