"""Small models for generic optimisers: one of complex waves, one of real data without a solution everywhere."""

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveModel
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import ridge
from ngbrain.materials import Shearing
from ngbrain.mesh.geometry.structured import rectangles

MODULUS, SIDE = 9e3, 0.12
"""Pa, m: shear waves of 100 mm at 30 Hz in a square."""


def waves():
    """9 moduli and 40 boundary values. Its law is not linear in θ, so that its derivatives change with θ in all ways."""
    mesh = rectangles(*[np.linspace(0, SIDE, 3)] * 2)
    storage = ngs.GridFunction(ngs.H1(mesh, order=1))
    storage.vec[:] = MODULUS
    shear = storage**2 / MODULUS * (1 + 0.2j)
    wave = Wave(30.0, {"top": (1e-3, 0)})
    body = HarmonicProblem(mesh, Shearing(shear), [wave], bulk=13 / 6 * shear, form="Q2", dirichlet="top|bottom")
    line = SIDE * np.linspace(0.05, 0.95, 5)
    return WaveModel(body, {"storage": storage}, np.array([(x, y) for x in line for y in line]))


class Exponential:
    """Real data d_i = Σ e^{5θ_j} A_ij, with a `ConvergenceError` where a θ is above `cap`; counts what it solves."""

    def __init__(self, size=8, cap=0.6):
        random = np.random.default_rng(3)
        self.A = random.uniform(0.1, 1.0, size=(size + 2, size))
        self.cap, self.solved, self.failed = cap, 0, 0

    def evaluate(self, theta):
        if np.max(theta) > self.cap:
            self.failed += 1
            raise ConvergenceError("the load cannot be carried")
        self.solved += 1
        return Tangent(self.A @ np.exp(5 * theta), self.A * (5 * np.exp(5 * theta)))


class Tangent:
    def __init__(self, data, J):
        self.data, self.J = data, J

    def jvp(self, direction):
        return self.J @ direction

    def vjp(self, w):
        return self.J.T @ w

    gradient = vjp

    def hvp(self, w, direction):
        return 5 * (self.J.T @ w) * direction


def reduced_of(model, start):
    """Its data at θ = 0.3 with weak ridges: the minimum is close to where it has no solution."""
    truth = np.full(model.A.shape[1], 0.3)
    fields = ParameterFields(truth, {"theta": slice(0, len(truth))}, {"theta": Unknown(start, ScaledTransform())})
    misfit = LeastSquares(model.evaluate(truth).data, 0.05)
    return Reduced(model, misfit, fields, {"theta": ridge(truth)}, {"theta": 1.0})
