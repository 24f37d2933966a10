"""Model evidence: whether a Gaussian prior with a correlation length fits the fields better than the regulariser.

Around the end of an inversion the data are linear in the fields f: y = Uᵀf + e with e of unit variance
(`Posterior.data_coordinates`). Under a Gaussian prior N(f̄, Σ s_b C_b), with a variance s_b per block b, their probability is

    ln p(y) = -½ ln det K - ½ y₀·K⁻¹y₀ + const ,   K = 1 + Σ s_b A_b ,   A_b = U_bᵀ C_b U_b ,   y₀ = y - Uᵀf̄

It is maximised over the correlation length and the variances, and compared between priors. H1 assumes rough fields, so that its
intervals cover smooth ones too often; total variation fits fields with steps. For a field that the data hardly determine, such as
a loss modulus, zero variance may fit best by chance; therefore the logarithms of the variances have a common mean with standard
deviation `LOG_VARIANCE_SPREAD`.

References
----------
MacKay 1992, 10.1162/neco.1992.4.3.415; Gelman 2006, 10.1214/06-BA117A.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
import scipy
import scipy.sparse as sp

from ngbrain.inverse.objective.regularisation import QuadraticRegulariser, matern
from ngbrain.inverse.objective.regularisers import extent
from ngbrain.inverse.optimise.gauss_newton_hessian import Metric
from ngbrain.inverse.uncertainty.posterior import Posterior
from ngbrain.look import BriefText

Array = np.ndarray
LENGTHS = (0.06, 0.12, 0.25, 0.5)
"""Correlation lengths to try, relative to the domain. The optimum is flat: from 0.25 to 0.7, ln p of CV-G changes by 4 of 450."""
LOG_VARIANCE_SPREAD = 1.0
"""Prior standard deviation of ln s_b around their mean: standard deviations of fields differ by a factor of 1.6."""
LARGEST = 20_000
"""Number of unknowns of a field up to which other priors are tried: their factors are direct ones."""


@dataclass(frozen=True, repr=False)
class GaussianPrior(BriefText):
    """Gaussian prior of the fields.

    Parameters
    ----------
    length : float
        Correlation length (m).
    regularisers : dict of str to QuadraticRegulariser
        Regulariser of each block.
    weights : dict of str to float
        Weight of each block.
    gain : float
        Increase of ln p(y) over the prior of the inversion.
    """

    length: float
    regularisers: dict[str, QuadraticRegulariser]
    weights: dict[str, float]
    gain: float


def evidence(parts: Sequence[Array], y: Array) -> tuple[float, Array]:
    """Maximise ln p(y) over the variances of the blocks.

    Parameters
    ----------
    parts : sequence of array (k, k)
        Matrix A_b of each block.
    y : array (k,)
        Data coordinates y₀.

    Returns
    -------
    probability : float
        Maximum of ln p(y), the prior of the variances included.
    variances : array (blocks,)
        Variances s at the maximum.

    Examples
    --------
    >>> draws = np.random.default_rng(0).normal(size=400) * 3
    >>> _, (variance,) = evidence([np.eye(400)], draws)
    >>> bool(abs(variance / (np.mean(draws**2) - 1) - 1) < 1e-3)
    True
    """

    def negative_log_probability(logarithms: Array) -> tuple[float, Array]:
        shares = [np.exp(each) * part for each, part in zip(logarithms, parts, strict=True)]
        K = np.eye(len(y)) + sum(shares)
        inverse = np.linalg.inv(K)
        solved = inverse @ y
        slope = [0.5 * (np.sum(inverse * share) - solved @ share @ solved) for share in shares]
        deviation = (logarithms - logarithms.mean()) / LOG_VARIANCE_SPREAD
        return 0.5 * (np.linalg.slogdet(K)[1] + y @ solved + deviation @ deviation), np.array(
            slope
        ) + deviation / LOG_VARIANCE_SPREAD

    start = [-np.log(max(np.trace(part) / len(y), 1e-300)) for part in parts]
    tries = [
        scipy.optimize.minimize(negative_log_probability, np.add(start, more), jac=True, method="L-BFGS-B")
        for more in (0.0, 4.0)
    ]
    best = min(tries, key=lambda found: found.fun)
    return -float(best.fun), np.exp(best.x)


def best_prior(posterior: Posterior, space: ngs.FESpace, means: Mapping[str, float]) -> GaussianPrior | None:
    """Find the Gaussian prior that fits best.

    Parameters
    ----------
    posterior : Posterior
        Posterior of the inversion.
    space : FESpace
        Space of the fields, for all regularised blocks.
    means : mapping of str to float
        Mean of each block, around which the Gaussian fields vary.

    Returns
    -------
    GaussianPrior or None
        None where the prior of the inversion fits better, or the fields are too large.
    """
    blocks = {name: posterior.block_indices(name) for name in posterior.regularised}
    if not blocks or space.ndof > LARGEST or any(len(each) != space.ndof for each in blocks.values()):
        return None
    U, y = posterior.data_coordinates
    own = [
        _data_covariance(Metric(sp.csr_array(posterior.regular[each][:, each])), U[each]) for each in blocks.values()
    ]
    least, _ = evidence(own, y - U.T @ posterior.reference)
    one = ngs.GridFunction(space)
    one.Set(1.0)
    uniform = {name: means[name] * one.vec.FV().NumPy() for name in blocks}
    around = np.concatenate(list(uniform.values()))
    best = None
    for length in np.multiply(LENGTHS, extent(space)):
        matrix = matern(space, 0.0, float(length)).matrix(np.zeros(0))
        metric = Metric(matrix)
        probability, variances = evidence(
            [_data_covariance(metric, U[each]) for each in blocks.values()], y - U.T @ around
        )
        if best is None or probability - least > best.gain:
            regularisers = {name: QuadraticRegulariser(matrix, uniform[name]) for name in blocks}
            weights = dict(zip(blocks, (1 / variances).tolist(), strict=True))
            best = GaussianPrior(float(length), regularisers, weights, probability - least)
    return best if best is not None and best.gain > 0 else None


def _data_covariance(metric: Metric, rows: Array) -> Array:
    white = metric.whiten_gradient(rows)
    return np.asarray(white.T @ white)
