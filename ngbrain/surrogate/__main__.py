"""`python -m ngbrain.surrogate waves -o DIR`: compute the data, train the operator, write the weights that ngbrain ships.

A run that was stopped goes on when it is started again: data are computed once, training has a checkpoint an epoch.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from pathlib import Path

from ngbrain.errors import require
from ngbrain.io.json_file import write_json
from ngbrain.surrogate.data import MODALITIES, DataSet, generate
from ngbrain.surrogate.shipped import Operator
from ngbrain.surrogate.trust import calibrate

TRAINING = {
    "gaussian_place": 500,
    "gaussian_width": 500,
    "sinusoidal": 350,
    "sinc": 350,
    "inclusions": 500,
    "tumour": 400,
    "halves": 300,
}
"""Samples of each family."""
UNSEEN = "slices"
"""The family that is tested with alone."""
JUDGES, TESTS = 25, 50
"""Samples of each family to validate and to test with."""
ACROSS, ACROSS_TEST = 51, 101


def main() -> None:
    """Data, training, export."""
    parser = argparse.ArgumentParser(
        prog="python -m ngbrain.surrogate", description="Train what `ngbrain predict` uses."
    )
    parser.add_argument("modality", choices=list(MODALITIES))
    parser.add_argument("-o", dest="output", type=Path, default=Path("surrogate"), metavar="DIR")
    parser.add_argument("--epochs", type=int, default=50)
    parser.add_argument("--rate", type=float, default=0.02, help="highest learning rate")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, metavar="N", help="processes that compute data"
    )
    parser.add_argument("--data", action="store_true", help="no training, the data alone")
    arguments = parser.parse_args()
    for package in () if arguments.data else ("torch", "onnx", "onnxruntime"):
        require(package, "train")
    folder, name = arguments.output, arguments.modality
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {
        "train": (TRAINING, ACROSS),
        "validation": (dict.fromkeys(TRAINING, JUDGES), ACROSS),
        "test": ({**dict.fromkeys(TRAINING, TESTS), UNSEEN: 2 * TESTS}, ACROSS_TEST),
    }
    for split, (counts, across) in wanted.items():
        path = folder / f"{name}_{split}.h5"
        if not path.exists():
            print(f"{path}: {sum(counts.values())} samples", flush=True)
            generate(path, name, counts, split, arguments.seed, across, arguments.workers)
    if not arguments.data:
        learn(folder, name, arguments.epochs, arguments.rate, arguments.seed)


def learn(folder: Path, name: str, epochs: int, rate: float, seed: int) -> None:
    """Train on what is in the folder and write the weights there."""
    import torch

    from ngbrain.surrogate.export import export
    from ngbrain.surrogate.train import Settings, train
    from ngbrain.surrogate.wavelet_operator import WaveletOperator, weights

    training, validation = (DataSet.read(folder / f"{name}_{split}.h5") for split in ("train", "validation"))
    settings = Settings(epochs=epochs, rate=rate, seed=seed)

    def tell(epoch: dict[str, float]) -> None:
        print(", ".join(f"{key} {value:.4g}" for key, value in epoch.items()), flush=True)

    model = train(WaveletOperator, training, validation, folder / name, settings, tell)
    curve = torch.load(folder / name / "checkpoint.pt", weights_only=True)["curve"]
    card = {
        "command": f"python -m ngbrain.surrogate {name} --epochs {epochs} --rate {rate:g} --seed {seed}",
        "modality": name,
        "settings": asdict(settings),
        "weights": weights(model),
        "families": TRAINING,
        "sha256": {"train": training.sha256, "validation": validation.sha256},
        "torch": torch.__version__,
        "curve": curve,
    }
    export(model, folder, name, card)
    card |= calibrate(Operator.of(folder, name), training, validation, seed)
    write_json(folder / f"{name}.json", card)


if __name__ == "__main__":
    main()
