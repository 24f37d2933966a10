"""The wavelet neural operator.

- `derivatives`: derivatives of fields on square grids by local polynomials
- `encoding`: input channels and targets, in dimensionless form
- `symmetries`: random mirror images, rotations and phases of the data
- `wavelet_operator`: the network, from displacement to property maps on any grid (needs PyTorch)
- `wavelets`: two-dimensional wavelet transform by matrix products (needs PyTorch)
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.surrogate.operator import derivatives, encoding, symmetries, wavelet_operator
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["derivatives", "encoding", "symmetries", "wavelet_operator", "wavelets"]
