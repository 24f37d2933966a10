"""Error budget, spread of the published materials, and verification runs.

- `error_budget`: Balances of the runs, discretisation errors, and the spread due to the material.
- `material_uncertainty`: Spread of the answers over published moduli and exponents, beside the discretisation errors.
- `verification_runs`: Runs with another time step, order, mesh, or exponent of the law.
"""

__all__ = ["error_budget", "material_uncertainty", "verification_runs"]
