"""The objective function of an inversion: misfit, parameter transforms, regularisers.

- `misfit`: Data misfit in units of the noise: least squares, and Huber's robust misfit.
- `parameters`: Unknown fields and their transforms (logarithm, bounds, scale), nodal or one value per label.
- `regularisation`: Regularisers of a field: H1 smoothness, total variation, Matérn covariance, ridge.
- `regularisers`: The regularisers that `invert` offers by name.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse.objective import misfit, parameters, regularisation, regularisers
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["misfit", "parameters", "regularisation", "regularisers"]
