"""`python -m ngbrain.surrogate waves -o DIR`: compute the data, train the operator, write the weights that ngbrain ships.

An interrupted run resumes when it is started again: data are computed once, training writes a checkpoint after each
epoch.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ngbrain.errors import require
from ngbrain.io.json_file import write_json
from ngbrain.parallel import open_executor
from ngbrain.surrogate.data.dataset import MODALITIES, DataSet, generate
from ngbrain.surrogate.prediction.pretrained import Operator
from ngbrain.surrogate.prediction.trust import calibrate

TRAINING = {
    "gaussian_place": 500,
    "gaussian_width": 500,
    "sinusoidal": 350,
    "sinc": 350,
    "inclusions": 500,
    "tumour": 400,
    "halves": 300,
}
"""Training samples of each family."""
UNSEEN = "slices"
"""Family that only the test set contains."""
JUDGES, TESTS = 25, 50
"""Validation and test samples of each family."""
ACROSS, ACROSS_TEST = 51, 101


def main() -> None:
    """Compute data, train and export."""
    parser = argparse.ArgumentParser(
        prog="python -m ngbrain.surrogate", description="Train what `ngbrain predict` uses."
    )
    parser.add_argument("modality", choices=list(MODALITIES))
    parser.add_argument("-o", dest="output", type=Path, default=Path("surrogate"), metavar="DIR")
    parser.add_argument("--epochs", type=int, default=50)
    parser.add_argument("--rate", type=float, default=0.02, help="highest learning rate")
    parser.add_argument(
        "--start", type=Path, metavar="FILE", help="checkpoint.pt of an earlier training whose weights are the start"
    )
    parser.add_argument(
        "--twice",
        nargs="*",
        default=(),
        choices=list(TRAINING),
        metavar="FAMILY",
        help="families that appear twice as often",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--executor",
        default=str(os.cpu_count() or 1),
        metavar="WHO",
        help="executor of the data generation: N processes, dask:ADDRESS, mpi[:N] or slurm[:KEY=VALUE,...]",
    )
    parser.add_argument("--data", action="store_true", help="compute the data only")
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
            with open_executor(arguments.executor) as executor:
                generate(path, name, counts, split, arguments.seed, across, executor)
    if not arguments.data:
        of = {key: getattr(arguments, key) for key in ("epochs", "rate", "seed")}
        learn(folder, name, {**of, "twice": tuple(arguments.twice)}, arguments.start)


def learn(folder: Path, name: str, of: dict[str, Any], start: Path | None) -> None:
    """Train on the data in a folder and write the weights there.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the data and of the results.
    name : str
        Modality, "waves" or "compression".
    of : dict of str to object
        Fields of `Settings`.
    start : pathlib.Path
        Checkpoint of an earlier training to continue from.
    """
    import torch

    from ngbrain.surrogate.operator.wavelet_operator import WaveletOperator, count_weights
    from ngbrain.surrogate.training.export import export
    from ngbrain.surrogate.training.training import Settings, train

    training, validation = (DataSet.read(folder / f"{name}_{split}.h5") for split in ("train", "validation"))
    settings = Settings(**of)

    def callback(epoch: dict[str, float]) -> None:
        print(", ".join(f"{key} {value:.4g}" for key, value in epoch.items()), flush=True)

    model = train(WaveletOperator, training, validation, folder / name, settings, callback, start)
    checkpoint = torch.load(folder / name / "checkpoint.pt", weights_only=True)
    trainings = list(_trainings(checkpoint["made_by"]))[::-1]
    card = {
        "command": " && ".join(_command(name, i, each) for i, each in enumerate(trainings)),
        "modality": name,
        "settings": trainings,
        "weights": count_weights(model),
        "families": TRAINING,
        "sha256": {"train": training.sha256, "validation": validation.sha256},
        "torch": torch.__version__,
        "curve": [{key: _short(value) for key, value in epoch.items()} for epoch in checkpoint["curve"]],
    }
    card = export(model, folder, name, card)
    card |= calibrate(Operator.load(folder, name), training, validation, settings.seed)
    write_json(folder / f"{name}.json", card)


def _short(value: float) -> float:
    """Four significant digits; integers unchanged."""
    return value if isinstance(value, int) else float(f"{value:.4g}")


def _trainings(made_by: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Settings of the last training, of the one that it continued, and so on."""
    yield {key: value for key, value in made_by.items() if key not in ("data", "start")}
    if "start" in made_by:
        yield from _trainings(made_by["start"])


def _command(name: str, number: int, of: dict[str, Any]) -> str:
    """Command that repeats training number `number`."""
    start = f" --start {number - 1}/{name}/checkpoint.pt" if number else ""
    numbers = f"--epochs {of['epochs']} --rate {of['rate']:g} --seed {of['seed']}"
    twice = f" --twice {' '.join(of['twice'])}" if of.get("twice") else ""
    return f"python -m ngbrain.surrogate {name} {numbers}{twice}{start} -o {number}"


if __name__ == "__main__":
    main()
