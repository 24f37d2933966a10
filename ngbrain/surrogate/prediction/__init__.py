"""Property maps by the trained operator, with standard deviations and out-of-distribution checks.

- `predict`: maps of wave data with standard deviations, and reasons not to trust them
- `pretrained`: shipped weights (ONNX) and their model cards
- `tiling`: prediction for a field from one or several overlapping squares
- `trust`: out-of-distribution scores and their calibration
"""

__all__ = ["predict", "pretrained", "tiling", "trust"]
