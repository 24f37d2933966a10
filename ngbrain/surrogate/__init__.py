"""Property maps from displacement fields in hundredths of a second: a wavelet neural operator, its data and its training.

- prediction: `predict` (a `Prediction`), `predict_field`, `TilePrediction`; the shipped `Operator` and its `ModelCard`
- whether to trust it: out-of-distribution `scores` and their `auc`; `wave_residual`, `compression_residual` of the maps
- training data: `sample` (a `Sample`), `generate`, `DataSet`, `solve_displacement`; `family` of random maps
- constants of the training data: `DENSITY`, ranges of `FREQUENCY` and `SHEAR`, `SIDES` of the squares, `FINE` (points across a
  random map), families `SMOOTH` and `SHARP`, `GRAIN` (correlation length of noise)
- input: `Raster`, `modality` (a `Modality`), `add_noise`, `relative_errors`

Modules
-------
- `prediction`: maps of wave data by a trained operator, and out-of-distribution checks
- `operator`: the wavelet neural operator and its input channels
- `data`: training data, rasters, residuals of the equations of motion
- `training`: training and export (needs PyTorch)

`python -m ngbrain.surrogate` computes the data, trains the operator and writes the weights that the package ships.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.surrogate import data, operator, prediction, training
    from ngbrain.surrogate.data.dataset import (
        DENSITY,
        FINE,
        FREQUENCY,
        SHEAR,
        SIDES,
        DataSet,
        Sample,
        generate,
        sample,
        solve_displacement,
    )
    from ngbrain.surrogate.data.random_fields import SHARP, SMOOTH, family
    from ngbrain.surrogate.data.raster import Raster
    from ngbrain.surrogate.data.residual import compression_residual, wave_residual
    from ngbrain.surrogate.operator.encoding import GRAIN, Modality, add_noise, modality, relative_errors
    from ngbrain.surrogate.prediction.predict import Prediction, predict
    from ngbrain.surrogate.prediction.pretrained import ModelCard, Operator
    from ngbrain.surrogate.prediction.tiling import TilePrediction, predict_field
    from ngbrain.surrogate.prediction.trust import auc, scores
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "DENSITY",
    "FINE",
    "FREQUENCY",
    "GRAIN",
    "SHARP",
    "SHEAR",
    "SIDES",
    "SMOOTH",
    "DataSet",
    "Modality",
    "ModelCard",
    "Operator",
    "Prediction",
    "Raster",
    "Sample",
    "TilePrediction",
    "add_noise",
    "auc",
    "compression_residual",
    "data",
    "family",
    "generate",
    "modality",
    "operator",
    "predict",
    "predict_field",
    "prediction",
    "relative_errors",
    "sample",
    "scores",
    "solve_displacement",
    "training",
    "wave_residual",
]
