"""Which prior fits the fields that were found: that of the inversion, or Gaussian fields that are correlated over a length.

Around an inversion's end data are linear in the fields f: y = Uᵀf + e, e of unit variance (`Posterior.informing`). A Gaussian prior
N(f̄, Σ s_b C_b), a variance s_b for each block b, then gives data the probability

    ln p(y) = -½ ln det K - ½ y₀·K⁻¹y₀ + const ,   K = 1 + Σ s_b A_b ,   A_b = U_bᵀ C_b U_b ,   y₀ = y - Uᵀf̄

It is largest at the length and the variances that fit best, and larger for the prior that fits better. H1 takes fields for rough,
so that intervals hold smooth ones too often; total variation fits fields with steps. Of a field that data say little of, such as a
loss modulus, a variance of nothing may fit best by chance; so logarithms of variances are expected to be alike, within `ALIKE`.
Sources: MacKay 1992, 10.1162/neco.1992.4.3.415; Gelman 2006, 10.1214/06-BA117A.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
from scipy.optimize import minimize

from ngbrain.inverse.objective.regularisation import QuadraticRegulariser, matern
from ngbrain.inverse.objective.regularisers import extent
from ngbrain.inverse.optimise.gauss_newton_hessian import Metric
from ngbrain.inverse.uncertainty.posterior import Posterior

Array = np.ndarray
LENGTHS = (0.06, 0.12, 0.25, 0.5)
"""Of the body: lengths that are tried. The best is flat: from .25 to .7 ln p of CV-G's data moves by 4 of 450."""
ALIKE = 1.0
"""Standard deviation of ln s_b around their mean: standard deviations of fields differ by a factor of 1.6."""
LARGEST = 20_000
"""Unknowns of a field up to which other priors are tried: their factors are direct ones."""


@dataclass(frozen=True)
class GaussianPrior:
    """Of fields: correlated over `length` (m), block → regulariser and weight; how far ln p(y) is above that of the inversion's."""

    length: float
    regularisers: dict[str, QuadraticRegulariser]
    weights: dict[str, float]
    gain: float


def evidence(parts: Sequence[Array], y: Array) -> tuple[float, Array]:
    """The largest ln p(y) over variances s of matrices A (k, k), with those of ln s that are alike, and these s.

    >>> draws = np.random.default_rng(0).normal(size=400) * 3
    >>> _, (variance,) = evidence([np.eye(400)], draws)
    >>> bool(abs(variance / (np.mean(draws**2) - 1) - 1) < 1e-3)
    True
    """

    def lost(logarithms: Array) -> tuple[float, Array]:
        shares = [np.exp(each) * part for each, part in zip(logarithms, parts, strict=True)]
        K = np.eye(len(y)) + sum(shares)
        inverse = np.linalg.inv(K)
        pulled = inverse @ y
        slope = [0.5 * (np.sum(inverse * share) - pulled @ share @ pulled) for share in shares]
        apart = (logarithms - logarithms.mean()) / ALIKE
        return 0.5 * (np.linalg.slogdet(K)[1] + y @ pulled + apart @ apart), np.array(slope) + apart / ALIKE

    start = [-np.log(max(np.trace(part) / len(y), 1e-300)) for part in parts]
    tries = [minimize(lost, np.add(start, more), jac=True, method="L-BFGS-B") for more in (0.0, 4.0)]
    best = min(tries, key=lambda found: found.fun)
    return -float(best.fun), np.exp(best.x)


def best_prior(posterior: Posterior, space: ngs.FESpace, means: Mapping[str, float]) -> GaussianPrior | None:
    """The Gaussian fields that fit best; None where the inversion's own prior fits better, or fields are too large to ask.

    space   of the fields, all blocks that are regularised
    means   block → its mean, which the Gaussian fields vary around
    """
    blocks = {name: posterior.block_indices(name) for name in posterior.regularised}
    if not blocks or space.ndof > LARGEST or any(len(each) != space.ndof for each in blocks.values()):
        return None
    U, y = posterior.data_coordinates
    own = [_of(Metric(sp.csr_array(posterior.regular[each][:, each])), U[each]) for each in blocks.values()]
    least, _ = evidence(own, y - U.T @ posterior.reference)
    one = ngs.GridFunction(space)
    one.Set(1.0)
    uniform = {name: means[name] * one.vec.FV().NumPy() for name in blocks}
    around = np.concatenate(list(uniform.values()))
    best = None
    for length in np.multiply(LENGTHS, extent(space)):
        matrix = matern(space, 0.0, float(length)).matrix(np.zeros(0))
        metric = Metric(matrix)
        probability, variances = evidence([_of(metric, U[each]) for each in blocks.values()], y - U.T @ around)
        if best is None or probability - least > best.gain:
            regularisers = {name: QuadraticRegulariser(matrix, uniform[name]) for name in blocks}
            weights = dict(zip(blocks, (1 / variances).tolist(), strict=True))
            best = GaussianPrior(float(length), regularisers, weights, probability - least)
    return best if best is not None and best.gain > 0 else None


def _of(metric: Metric, rows: Array) -> Array:
    white = metric.whiten_gradient(rows)
    return np.asarray(white.T @ white)
