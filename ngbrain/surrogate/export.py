"""A trained surrogate as files that need no PyTorch: NAME.onnx, and NAME.json that says what made it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from ngbrain.errors import require
from ngbrain.io.json_file import write_json
from ngbrain.io.whole import whole
from ngbrain.surrogate.train import Surrogate

OPSET = 17


def export(model: Surrogate, folder: Path, name: str, card: Mapping[str, Any]) -> None:
    """Write NAME.onnx, `features` (batch, channels, ny, nx) → `mean`, `scale` (batch, answers, ny, nx), and then NAME.json.

    One file serves any batch and grid. Raises `MissingExtra` without onnx.
    """
    require("onnx", "train")
    axes = {0: "batch", 2: "ny", 3: "nx"}
    names = ["features", "mean", "scale"]
    channels = model.centre.shape[1]

    def write(part: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of this way of tracing; the new one needs one more package
            torch.onnx.export(
                model.eval(),
                (torch.zeros(2, channels, 51, 51),),
                str(part),
                dynamo=False,
                opset_version=OPSET,
                input_names=names[:1],
                output_names=names[1:],
                dynamic_axes=dict.fromkeys(names, axes),
            )

    folder.mkdir(parents=True, exist_ok=True)
    whole(folder / f"{name}.onnx", write)
    write_json(folder / f"{name}.json", dict(card))
