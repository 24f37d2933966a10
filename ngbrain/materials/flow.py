"""Finite viscoelasticity: Maxwell branches whose spring and dashpot are a law of their own and a viscosity.

A branch has an inner state C_v; its spring sees the elastic part of the shape, F_e = F̄ F_v⁻¹, through an isotropic law
W(C_e), and its dashpot flows with the overstress, τ = 2η D_v. With a step's C_v⁻¹ = GGᵀ, the elastic logarithmic strains
before the step's flow are x_i = ½ ln (eigenvalues of GᵀC̄G), traceless, and after it they are the e that minimises

    W(e) + κ |x - e|² ,     κ of the order of 2η/Δt ,

so a step is a minimisation here too, its stress 2κ(x - e) = ∂W/∂e. Backward Euler's κ = η/Δt is first order; here G is
first relaxed over half of the step with the stress it had, and κ is half a step's, both with the factors that make a
branch of constant modulus exact for ramps of any length (as the hereditary one is): with y = μΔt/η, 2μ = |∂W|²/(e·∂W),

    e ← e - θ Δt/4η ∂W/∂e ,  θ = 2/y (1 - y/(exp y - 1)) ;     κ = η/Δt · y β/(1 - β) ,  β = (1 - exp(-y))/y .

Second order otherwise, stable for any Δt; Δt → 0 gives W, Δt → ∞ no stress. Unlike a hereditary branch's its free energy
is one of its state, so every step dissipates.

Source: Reese & Govindjee 1998, 10.1016/S0020-7683(97)00217-5; as a minimum: Ortiz & Stainier 1999,
10.1016/S0045-7825(98)00219-9; Fancello, Ponthot & Stainier 2006, 10.1002/nme.1525.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Deformation, Law, Value, density, positive
from ngbrain.materials.points import Points, initial_modulus, isotropic, number, varies
from ngbrain.tensors import deviator, principal_values, six, split_principal_values

PLANE = np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2], [6]])
"""Two unit vectors that span the traceless strains; a strain's coordinates are PLANE @ (e₁, e₂, e₃)."""
TOLERANCE = 1e-12
"""Of elastic strains, in a step's minimum."""
ITERATIONS = 60
HALVINGS = 10
SMALL = 1e-6
"""Elastic strain below which a branch has its modulus at rest."""
SUDDEN = 1e-12
"""Duration of a sudden change, in relaxation times."""


@dataclass(frozen=True)
class Maxwell:
    """A spring and a dashpot in series: an isotropic law W and a viscosity η (Pa s); `InputError` for a law with fibres.

    >>> from ngbrain.materials import NeoHooke, Viscous
    >>> tissue = Viscous(NeoHooke(160.0), (Maxwell(NeoHooke(970.0), eta=2190.0),))
    """

    law: Law
    eta: Value

    def __post_init__(self) -> None:
        positive(self.eta, "Maxwell.eta")
        if not varies(self.law) and not isotropic(self.law):
            raise InputError("Maxwell.law", self.law, "an isotropic law; fibres can stand beside it, in what stays")

    @property
    def tau(self) -> Value:
        """Relaxation time η/μ₀ (s) at small strain."""
        return self.eta / initial_modulus(self.law)

    def slopes(self, strain: CoefficientFunction) -> CoefficientFunction:
        """W, ∂W (2 entries) and ∂²W (11, 12, 22) at elastic strains given by their two coordinates (see `PLANE`)."""
        first, second = ((1.0 * strain[i]).MakeVariable() for i in range(2))
        logs = [float(PLANE[0, i]) * first + float(PLANE[1, i]) * second for i in range(3)]
        zero = ngs.CF(0.0)
        squares = [ngs.exp(2 * log) for log in logs]
        stretch = ngs.CF((squares[0], zero, zero, zero, squares[1], zero, zero, zero, squares[2]), dims=(3, 3))
        of_logs = getattr(self.law, "of_logs", None)
        W = of_logs(logs) if of_logs else density(self.law, Deformation.of_stretch(stretch))
        by = W.Diff(first), W.Diff(second)
        return ngs.CF((W, *by, by[0].Diff(first), by[0].Diff(second), by[1].Diff(second))).Compile()

    def overstress(self, points: Points, C: CoefficientFunction, times: np.ndarray) -> np.ndarray:
        """2 ∂W/∂C̄ (Pa), shape (histories, times, 3, 3), under given histories of C̄, the first value put on suddenly.

        C holds its values at `points`: one history after the other.
        """
        histories = points(C).reshape(9, -1, len(times))
        sample = Points.line(histories.shape[1])
        flow = Flow(sample, self.slopes, number(self.eta))
        shape = sample.field(histories[:, :, 0])
        trial = flow.trial(ngs.CF(tuple(shape[i] for i in range(9)), dims=(3, 3)))
        answer = np.empty((*histories.shape[1:], 3, 3))
        before = six_of(np.tile(np.eye(3).reshape(9, 1), histories.shape[1]))
        for n, dt in enumerate(np.diff(times, prepend=times[0] - SUDDEN * number(self.tau))):
            flow.begin(dt, before)
            sample.put(shape, histories[:, :, n])
            flow.relax(sample(trial))
            answer[:, n] = tensors(flow.stress)
            before = six_of(histories[:, :, n])
            flow.finish(before)
        return answer


class Flow:
    """A Maxwell branch at n points: what it remembers, and its part of a step's energy.

    points   `Points`
    slopes   elastic strain → `Maxwell.slopes` there
    eta      η (n,) in Pa s, 0 where there is no such branch

    The energy of a step is a quadratic function of x, with the slope and the curvature that the minimum has at the
    present state; `relax` sets them. Stress and tangent there are exact, without the law in the form that is assembled.
    `stress` is 2 ∂W/∂C̄ of the last `relax`, `six` entries (6, n) in Pa.
    """

    def __init__(
        self, points: Points, slopes: Callable[[CoefficientFunction], CoefficientFunction], eta: float | np.ndarray
    ) -> None:
        n = len(points.mapped)
        self.points, self.eta = points, np.broadcast_to(np.asarray(eta, float), (n,))
        self.kappa = np.zeros(n)
        self.G = np.tile(np.eye(3), (n, 1, 1))
        self._elastic = np.zeros((2, n))
        self.stress = np.zeros((6, n))
        self._strain = points.field(np.zeros((2, n)))
        self._slopes = slopes(self._strain)
        self._G = points.field(np.tile(np.eye(3).reshape(9, 1), n))
        self._frozen = points.field(np.zeros((8, n)))
        self._modulus = self._at(self._elastic)[3] / 2
        self._step = self.G

    def strain(self, C: CoefficientFunction) -> CoefficientFunction:
        """The two coordinates of x at the isochoric C̄, with the G of the step."""
        G = self._tensor
        return _coordinates(principal_values(G.trans * C * G))

    def trial(self, C: CoefficientFunction) -> CoefficientFunction:
        """What `relax` has to know of C̄: x, and the `six` entries each of ∂x₁/∂C̄ and ∂x₂/∂C̄.

        Derived by B = dev A with A = GᵀC̄G: by C̄ itself it takes NGSolve several times as long.
        """
        G = self._tensor
        A = G.trans * C * G
        q, B = (ngs.Trace(A) / 3).MakeVariable(), deviator(A).MakeVariable()
        x = _coordinates(split_principal_values(q, B))
        by_B, by_q = x.Diff(B).Reshape((2, 9)), x.Diff(q)
        slopes = []
        for i in range(2):
            of_B = ngs.CF(tuple(by_B[i, j] for j in range(9)), dims=(3, 3))
            by_A = deviator(of_B + of_B.trans) / 2 + by_q[i] / 3 * ngs.Id(3)
            slopes.append(six(G * by_A * G.trans))
        return ngs.CF((x, *slopes)).Compile()

    @property
    def _tensor(self) -> CoefficientFunction:
        return ngs.CF(tuple(self._G[i] for i in range(9)), dims=(3, 3))

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """The minimum, W* + s·(x - x*) + ½ (x - x*)·M (x - x*) with x*, W*, s and M of the last `relax`."""
        x, f = self.strain(C), self._frozen
        d1, d2 = x[0] - f[0], x[1] - f[1]
        return f[2] + f[3] * d1 + f[4] * d2 + (f[5] * d1 * d1 + f[7] * d2 * d2) / 2 + f[6] * d1 * d2

    def begin(self, dt: float, shapes: np.ndarray) -> None:
        """Start a step of `dt` seconds at the shapes C̄ (`six` entries, n): half of it with the stress there."""
        C = tensors(shapes)
        vectors, logs = _spectrum(np.swapaxes(self.G, 1, 2) @ C @ self.G)
        e = PLANE @ logs
        slope = self._at(e)[1:3]
        squared, along = np.sum(slope * slope, axis=0), np.sum(e * slope, axis=0)
        strained = (np.sum(e * e, axis=0) > SMALL**2) & (along > 0)  # at rest both are round-off
        modulus = np.where(strained, squared / (2 * np.where(strained, along, 1.0)), self._modulus)
        safe = np.where(self.eta > 0, self.eta, 1.0)
        theta, factor = half_step_factors(dt * modulus / safe)
        self.kappa = self.eta / dt * factor
        flowed = -theta * dt / (4 * safe) * slope
        for _ in range(HALVINGS):  # still downhill at its end, a path of flow has not gone uphill: it dissipates
            uphill = np.sum(self._at(e + flowed)[1:3] * slope, axis=0) < 0
            if not np.any(uphill):
                break
            flowed = np.where(uphill, flowed / 2, flowed)
        self._elastic = e + flowed
        self._step = self.G @ _compose(vectors, PLANE.T @ flowed)
        self.points.put(self._G, self._step.reshape(-1, 9).T)

    def relax(self, trial: np.ndarray) -> None:
        """Find the minimum at what `trial` says now (14, n); NaN where there is none. `stress` is that there."""
        x = trial[:2]
        e, slopes = self._minimum(x)
        self.stress = 2 * (slopes[1] * trial[2:8] + slopes[2] * trial[8:])
        W, (a, b, c), k = slopes[0] + self.kappa * np.sum((x - e) ** 2, axis=0), slopes[3:], 2 * self.kappa
        det = (a + k) * (c + k) - b * b
        M = np.array([a * (c + k) - b * b, k * b, c * (a + k) - b * b]) * k / np.where(det != 0, det, 1.0)
        self.points.put(self._frozen, np.array([*x, W, *slopes[1:3], *np.where(np.isfinite(e[0]), M, np.nan)]))

    def finish(self, shapes: np.ndarray) -> None:
        """End the step at the shapes C̄ (`six` entries, n)."""
        C = tensors(shapes)
        vectors, logs = _spectrum(np.swapaxes(self._step, 1, 2) @ C @ self._step)
        x = PLANE @ logs
        e, _ = self._minimum(x)
        self.G = self._step @ _compose(vectors, PLANE.T @ (e - x))

    @property
    def frozen(self) -> tuple[np.ndarray, np.ndarray]:
        """What the energy is made of now, G and what `relax` set, to be put back as it was."""
        return self._G.vec.FV().NumPy().copy(), self._frozen.vec.FV().NumPy().copy()

    @frozen.setter
    def frozen(self, values: tuple[np.ndarray, np.ndarray]) -> None:
        for field, value in zip((self._G, self._frozen), values, strict=True):
            field.vec.FV().NumPy()[:] = value

    def _at(self, e: np.ndarray) -> np.ndarray:
        self.points.put(self._strain, e)
        return self.points(self._slopes)

    def _minimum(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The minimising e and `slopes` there, by Newton's method with steps halved until the gradient shrinks."""
        k = 2 * self.kappa
        e = self._elastic
        slopes = self._at(e)
        gradient = slopes[1:3] - k * (x - e)
        for _ in range(ITERATIONS):
            h11, h12, h22 = slopes[3] + k, slopes[4], slopes[5] + k
            det = h11 * h22 - h12 * h12
            safe = np.where(det > 0, det, np.inf)
            step = -np.array([h22 * gradient[0] - h12 * gradient[1], h11 * gradient[1] - h12 * gradient[0]]) / safe
            left = np.max(np.abs(step), axis=0)
            if not np.any(left > TOLERANCE):
                break
            length = np.ones_like(left)
            for _ in range(12):
                tried = e + length * step
                there = self._at(tried)
                new = there[1:3] - k * (x - tried)
                worse = ~(np.sum(new * new, axis=0) <= np.sum(gradient * gradient, axis=0)) & (left > TOLERANCE)
                if not np.any(worse):
                    break
                length = np.where(worse, length / 2, length)
            e, slopes, gradient = tried, there, new
        else:
            e = np.where(left > 1e-8, np.nan, e)
        self._elastic = np.where(np.isfinite(e), e, 0.0)
        return e, slopes


def _coordinates(squares: Iterable[CoefficientFunction]) -> CoefficientFunction:
    """The two coordinates of ½ ln (squared stretches)."""
    logs = [ngs.log(value) / 2 for value in squares]
    return ngs.CF(tuple(sum(float(row[i]) * logs[i] for i in range(3)) for row in PLANE))


def six_of(tensors: np.ndarray) -> np.ndarray:
    """The `six` entries (6, n) of tensors given by rows (9, n)."""
    return tensors[[0, 4, 8, 5, 2, 1]]


def tensors(entries: np.ndarray) -> np.ndarray:
    """Symmetric tensors (n, 3, 3) from their `six` entries (6, n)."""
    return np.moveaxis(entries[np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])], 2, 0)


def half_step_factors(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """θ and κ Δt/η (see the module) of a step y = Δt/τ times the branch's relaxation time; 1 and 2 at y = 0.

    >>> theta, factor = half_step_factors(np.array([0.0, 1e6]))
    >>> theta.round(5).tolist(), factor.round(5).tolist()
    ([1.0, 0.0], [2.0, 1.0])
    """
    small = y < 1e-4
    y_ = np.where(small, 1.0, y)
    shrunk = y_ * np.exp(-y_) / -np.expm1(-y_)  # y/(exp y - 1)
    beta = -np.expm1(-y_) / y_
    return np.where(small, 1 - y / 6, 2 / y_ * (1 - shrunk)), np.where(small, 2 - y / 3, y_ * beta / (1 - beta))


def _spectrum(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvectors (n, 3, 3) and half the logarithms of the eigenvalues (3, n), the largest first."""
    values, vectors = np.linalg.eigh(A)
    return vectors[:, :, ::-1], np.log(values[:, ::-1].T) / 2


def _compose(vectors: np.ndarray, logs: np.ndarray) -> np.ndarray:
    """Σ exp(logs_i) n_i ⊗ n_i (n, 3, 3)."""
    return (vectors * np.exp(logs.T)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
