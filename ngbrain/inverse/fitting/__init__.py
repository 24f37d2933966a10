"""Parameters of any model, and of glued tissue specimens, from measured data.

- `estimate`: Parameters of a static or transient model by one call, with credible intervals.
- `bonded_specimen`: Material parameters from tests of specimens glued to their plates, by the full field of each specimen.
- `defect_correction`: Correction of an estimate by the data of a more accurate model.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse.fitting import bonded_specimen, defect_correction, estimate
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["bonded_specimen", "defect_correction", "estimate"]
