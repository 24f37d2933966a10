"""Property maps by the trained operator, and whether to trust them.

- `predict`: Property maps of wave data by a trained operator, with their standard deviations and whether to trust
  them.
- `pretrained`: Trained weights as they are shipped: an ONNX graph, run by onnxruntime on one core, and a card that
  says what made it.
- `tiling`: An operator's answer for one field, of one square or of several that lie over one another.
- `trust`: Whether an answer can be believed: what was seen and found, against what the operator has learnt from.
"""

__all__ = ["predict", "pretrained", "tiling", "trust"]
