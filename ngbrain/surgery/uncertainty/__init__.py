"""Error budget, spread of the published materials, and the runs that verify a result.

- `error_budget`: What the numbers of a retraction are worth: balances of its runs, errors of the numerics, spread of
  the material.
- `material_uncertainty`: How far the answer moves with what is not known: published moduli and exponents, beside the
  errors of the numerics.
- `verification_runs`: The runs that tell what the numbers of a retraction are worth: another time step, order, mesh,
  and exponent of the law.
"""

__all__ = ["error_budget", "material_uncertainty", "verification_runs"]
