"""Phantoms with known properties: published benchmarks, and draws from the prior.

- `benchmark`: Square elastography phantoms with simulated, noisy measurements.
- `prior_draws`: Phantoms whose properties are drawn from the prior, for which 95 % intervals must cover 95 % of the truth.
"""

__all__ = ["benchmark", "prior_draws"]
