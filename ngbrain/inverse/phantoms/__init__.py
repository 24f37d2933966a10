"""Phantoms with known truth: published benchmarks, and draws from the prior.

- `benchmark`: Phantoms of elastography: squares whose waves are computed, spoilt with noise, and looked at as if they
  were measured.
- `prior_draws`: Phantoms whose truth is drawn from what inversions assume of it: there intervals of 95 % have to hold
  95 % of the truth.
"""

__all__ = ["benchmark", "prior_draws"]
