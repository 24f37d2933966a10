"""Property maps from displacement fields in hundredths of a second: a wavelet neural operator, its data and its training.

- `prediction`: maps of wave data by a trained operator, and out-of-distribution checks
- `operator`: the wavelet neural operator and its input channels
- `data`: training data, rasters, residuals of the equations of motion
- `training`: training and export (needs PyTorch)

`python -m ngbrain.surrogate` computes the data, trains the operator and writes the weights that the package ships.
"""

__all__ = ["data", "operator", "prediction", "training"]
