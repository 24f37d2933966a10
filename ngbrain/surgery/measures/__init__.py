"""Measures of a simulated retraction: forces, pressures, strain, injury.

- `dose_response`: Infarct probability under a retractor: published animal counts and the interval that they imply.
- `injury`: Strain, stress and their rates at points, and the dose of a pressure.
- `observer`: Quantities recorded after every step: force, area, pressure, opening, work balances.
- `perfusion`: The perfusion reserve under a blade for a patient's arterial and intracranial pressure.
- `sampling`: Sampling points in tissue with stretches, stress and rates, and statistics that single points do not dominate.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.surgery.measures import dose_response, injury, observer, perfusion, sampling
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["dose_response", "injury", "observer", "perfusion", "sampling"]
