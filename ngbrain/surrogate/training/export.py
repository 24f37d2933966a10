"""Export of a trained surrogate to files that need no PyTorch: NAME.onnx, and NAME.json, its model card."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn

from ngbrain.atomic import atomic_write
from ngbrain.errors import require
from ngbrain.io.json_file import write_json
from ngbrain.surrogate.prediction.pretrained import DIGEST
from ngbrain.surrogate.training.training import Surrogate

OPSET = 17


def export(model: Surrogate, folder: Path, name: str, card: Mapping[str, Any]) -> dict[str, Any]:
    """Write NAME.onnx and NAME.json.

    The graph maps `features` (batch, channels, ny, nx) to `mean` and `scale` (batch, answers, ny, nx), for any
    batch and grid.

    Parameters
    ----------
    model : Surrogate
        Trained surrogate.
    folder : pathlib.Path
        Folder of the files.
    name : str
        NAME.
    card : dict of str to object
        Content of the model card.

    Returns
    -------
    dict of str to object
        The written card: `card` and the SHA-256 of the weights.

    Raises
    ------
    MissingExtra
        onnx is not installed.
    """
    channels = model.centre.shape[1]
    folder.mkdir(parents=True, exist_ok=True)
    atomic_write(folder / f"{name}.onnx", lambda part: write_onnx(model, part, channels, ["features", "mean", "scale"]))
    written = {**card, DIGEST: hashlib.sha256((folder / f"{name}.onnx").read_bytes()).hexdigest()}
    write_json(folder / f"{name}.json", written)
    return written


def write_onnx(net: nn.Module, file: Path, channels: int, names: list[str]) -> None:
    """Write a network as ONNX for any batch and grid.

    Parameters
    ----------
    net : nn.Module
        The network.
    file : pathlib.Path
        The file.
    channels : int
        Input channels.
    names : list of str
        Name of the input, then those of the outputs.

    Raises
    ------
    MissingExtra
        onnx is not installed.
    """
    require("onnx", "train")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of this way of tracing; the new one needs one more package
        torch.onnx.export(
            net.eval(),
            (torch.zeros(2, channels, 51, 51),),
            str(file),
            dynamo=False,
            opset_version=OPSET,
            input_names=names[:1],
            output_names=names[1:],
            dynamic_axes={key: {0: "batch", 2: "ny", 3: "nx"} for key in names},
        )
