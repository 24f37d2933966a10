"""Error budget, spread of the published materials, and verification runs.

- `error_budget`: Balances of the runs, discretisation errors, and the spread due to the material.
- `material_uncertainty`: Spread of the answers over published moduli and exponents, beside the discretisation errors.
- `coarse_answers`: Coarse scenes, and the intervals of their answers from a record of other scenes.
- `verification_runs`: Runs with another time step, order, mesh, or exponent of the law.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.surgery.uncertainty import coarse_answers, error_budget, material_uncertainty, verification_runs
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["coarse_answers", "error_budget", "material_uncertainty", "verification_runs"]
