"""The wavelet neural operator.

- `encoding`: What the operator sees of a displacement field, and what its answers mean: the way in and the way out,
  without units.
- `symmetries`: Squares that are the same but for how one looks at them.
- `wavelet_operator`: The wavelet neural operator: maps of displacement to maps of properties, on any grid.
- `wavelets`: The two-dimensional wavelet transform as products with small matrices, one for each level and axis.
"""

__all__ = ["encoding", "symmetries", "wavelet_operator", "wavelets"]
