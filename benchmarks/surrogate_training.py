"""Three networks of equal size learn the same: wavelet operator, Fourier operator, U-Net; and how much data the first needs.

Compression as ultrasound sees it (`ngbrain.surrogate.data`), 2900 samples of seven families, or fewer; 1 % noise in validation,
whose samples nobody has trained with. Every training passes over as many maps, with the settings of the shipped operator but for
that number. `error` is the mean over the two Gaussian families, `errors` has all of them, `curve` those after every epoch. CPU
time of the training, one thread.

Needs PyTorch and data: python -m ngbrain.surrogate compression -o out/surrogate --data

    python benchmarks/surrogate_training.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/surrogate_training.py --chart FILE.png < records.json
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _command import main
from _front import figure

from ngbrain.surrogate.data import COLUMNS, DataSet

Record = dict
FOLDER = Path("out/surrogate")
EPOCHS, SAMPLES = 8, (440, 1450, 2900)
GAUSSIAN = ("gaussian_place", "gaussian_width")
COLOURS = {"ngbrain:wavelet": "#0072B2", "ngbrain:Fourier": "#E69F00", "ngbrain:U-Net": "#009E73"}


def measure(quick: bool) -> list[Record]:
    """A record for each network, and for each number of samples."""
    import torch

    from ngbrain.surrogate.baselines import FourierOperator, UNet
    from ngbrain.surrogate.wavelet_operator import WaveletOperator

    torch.set_num_threads(1)
    training, validation = (DataSet.read(FOLDER / f"compression_{split}.h5") for split in ("train", "validation"))
    epochs = EPOCHS
    if quick:
        training, validation, epochs = spread(training, 70), spread(validation, 14), 2
    networks = {"ngbrain:wavelet": WaveletOperator, "ngbrain:Fourier": FourierOperator, "ngbrain:U-Net": UNet}
    records = [row(name, network, training, validation, epochs) for name, network in networks.items()]
    for count in SAMPLES[:0] if quick else SAMPLES[:-1]:
        fewer = spread(training, count)
        records.append(row("ngbrain:wavelet", WaveletOperator, fewer, validation, epochs * len(training) // count))
    return records


def spread(data: DataSet, count: int) -> DataSet:
    """So many samples, every family by its share."""
    rows = np.linspace(0, len(data) - 1, count).round().astype(int)
    return replace(data, **{key: getattr(data, key)[rows] for key in COLUMNS})


def row(name: str, network: Callable[[int, int], Any], training: DataSet, validation: DataSet, epochs: int) -> Record:
    """Train and judge."""
    from ngbrain.surrogate.train import Settings, train
    from ngbrain.surrogate.wavelet_operator import weights

    begun = time.process_time()
    curve: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        model = train(network, training, validation, Path(folder), Settings(epochs=epochs), curve.append)
    cpu = time.process_time() - begun
    last = {key.removeprefix("youngs "): value for key, value in curve[-1].items() if key.startswith("youngs ")}
    made: Record = {"method": name, "order": 0, "ndof": weights(model), "samples": len(training), "epochs": epochs}
    made |= {"error": float(np.mean([last[family] for family in GAUSSIAN])), "errors": last, "cpu_s": cpu}
    return made | {"converged": True, "curve": [{"maps": each["epoch"] * len(training), **each} for each in curve]}


def chart(records: list[Record], png: str) -> None:
    """Validation error over maps seen, for networks and numbers of samples."""
    plt, made, (left, right) = figure(10, 4, 2)
    most = max(r["samples"] for r in records)
    for r in records:
        maps = [each["maps"] / 1000 for each in r["curve"]]
        errors = [100 * np.mean([each[f"youngs {family}"] for family in GAUSSIAN]) for each in r["curve"]]
        if r["samples"] == most:
            label = f"{r['method'].partition(':')[2]}, {r['ndof'] / 1000:.0f} 000 weights, {r['cpu_s'] / 60:.0f} min"
            left.plot(maps, errors, "-", color=COLOURS[r["method"]], label=label)
        if r["method"] == "ngbrain:wavelet":
            right.plot(
                maps,
                errors,
                "-",
                lw=0.6 + r["samples"] / 1500,
                color=COLOURS[r["method"]],
                label=f"{r['samples']} samples",
            )
    for axes, title in ((left, "networks of equal size"), (right, "numbers of training samples")):
        axes.set(
            xlabel="thousand maps seen", ylabel="mean relative error, Gaussian spots, %", yscale="log", title=title
        )
        axes.grid(True, which="both", alpha=0.25)
        axes.legend(fontsize=8)
    made.savefig(png, dpi=130)
    plt.close(made)


def line(r: Record) -> str:
    """A record to read."""
    errors = ", ".join(f"{name} {100 * value:.2f} %" for name, value in r["errors"].items())
    return f"{r['method']:<16} {r['ndof']} weights, {r['samples']} samples, {r['epochs']} epochs, {r['cpu_s']:.0f} s: {errors}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
