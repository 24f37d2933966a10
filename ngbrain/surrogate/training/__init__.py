"""Training and export of the operator; needs PyTorch.

- `baselines`: Two common networks in the wavelet operator's place, with as many weights as its default: what it must
  beat.
- `export`: A trained surrogate as files that need no PyTorch: NAME.onnx, and NAME.json that says what made it.
- `optimisers`: How weights are moved: Muon on those of layers, which are matrices, AdamW on biases and all else, one
  schedule for both.
- `training`: Training: noise, symmetries and phases new in every epoch, normalisers from training data alone, a
  checkpoint an epoch.
"""

__all__ = ["baselines", "export", "optimisers", "training"]
