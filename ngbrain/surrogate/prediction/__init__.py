"""Property maps by the trained operator, with standard deviations and out-of-distribution checks.

- `predict`: maps of wave data with standard deviations, and reasons not to trust them
- `pretrained`: shipped weights (ONNX) and their model cards
- `tiling`: prediction for a field from one or several overlapping squares
- `trust`: out-of-distribution scores and their calibration
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.surrogate.prediction import predict, pretrained, tiling, trust
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["predict", "pretrained", "tiling", "trust"]
