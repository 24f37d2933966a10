"""Uncertainty of estimates: posterior covariance, credible intervals, credible maps.

- `posterior`: Laplace approximation N(x*, H⁻¹) of the posterior, by a low-rank update of the prior covariance.
- `interval`: Credible intervals of numbers and arrays.
- `credible_maps`: Error bars of the property maps of `invert`.
- `evidence`: Model evidence: whether a Gaussian prior with a correlation length fits the fields better than the regulariser.
- `randomised_eigenvalues`: Dominant eigenvalues of a symmetric operator, by a randomised two-pass method.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse.uncertainty import credible_maps, evidence, interval, posterior, randomised_eigenvalues
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["credible_maps", "evidence", "interval", "posterior", "randomised_eigenvalues"]
