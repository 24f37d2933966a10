"""Phantoms with known properties: published benchmarks, and draws from the prior.

- `benchmark`: Square elastography phantoms with simulated, noisy measurements.
- `prior_draws`: Phantoms whose properties are drawn from the prior, for which 95 % intervals must cover 95 % of the truth.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse.phantoms import benchmark, prior_draws
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["benchmark", "prior_draws"]
