"""Training and export of the operator (needs PyTorch).

- `baselines`: a U-Net and a Fourier neural operator of the same size, for comparison
- `export`: a trained network as ONNX file with a model card
- `optimisers`: Muon for matrices, AdamW for all other weights
- `training`: the training loop
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.surrogate.training import baselines, export, optimisers, training
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["baselines", "export", "optimisers", "training"]
