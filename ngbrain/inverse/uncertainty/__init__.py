"""How far an estimate may be off: posterior, intervals, credible maps.

- `credible_maps`: Error bars of property maps: what `invert` found, with its `Posterior`, in the units of the maps.
- `evidence`: Which prior fits the fields that were found: that of the inversion, or Gaussian fields that are
  correlated over a length.
- `interval`: What is known of a number, or of each of many by itself: its value, how far it may be off, and between
  which ends it lies.
- `posterior`: How far unknowns may be off, to second order around the point where an inversion ended: N(x*, H⁻¹), H =
  JᵀWJ + Σ αR.
- `randomised_eigenvalues`: The large eigenvalues of a symmetric matrix that is known by its products, by random
  vectors in two passes.
"""

__all__ = ["credible_maps", "evidence", "interval", "posterior", "randomised_eigenvalues"]
