"""Parameters of any model from measured data.

- `bonded_specimen`: Constants of a law from tests of blocks that stick to their plates, as soft tissue is glued: by
  the whole field of each block.
- `defect_correction`: What a better model's data at the point found would change of it, without an inversion by that
  model.
- `estimate`: Any model inverted by one call: its parameters from what was measured and how noisy that is.
"""

__all__ = ["bonded_specimen", "defect_correction", "estimate"]
