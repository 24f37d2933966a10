"""Training and export of the operator (needs PyTorch).

- `baselines`: a U-Net and a Fourier neural operator of the same size, for comparison
- `export`: a trained network as ONNX file with a model card
- `optimisers`: Muon for matrices, AdamW for all other weights
- `training`: the training loop
"""

__all__ = ["baselines", "export", "optimisers", "training"]
