"""Factors of an operator's accuracy: kind of network, width, levels, amount of data.

Three networks of equal size, the wavelet operator, a Fourier operator and a U-Net; the first with other widths, levels and numbers
of samples. Waves, and compression as ultrasound sees it (`ngbrain.surrogate.data.dataset`): 2900 samples of seven families,
or fewer; 1 %
noise in validation, whose samples nobody has trained with. Every training passes over as many maps, with the settings of the
shipped operators but for that number, which is a small part of theirs: what is compared is not yet at its best. `error` is the
mean over the two Gaussian families of the first modulus, `errors` has all of them, `curve` those after every epoch. CPU time of the
training, one thread.

Needs PyTorch and data: python -m ngbrain.surrogate waves -o out/surrogate --data, and so for compression

    python benchmarks/surrogate_training.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/surrogate_training.py --chart FILE.png < records.json
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from _command import main
from _front import figure

from ngbrain.surrogate import DataSet, modality, operator
from ngbrain.surrogate import data as training_data
from ngbrain.surrogate import training as trainers

Record = dict
FOLDER = Path("out/surrogate")
MODALITIES = ("waves", "compression")
EPOCHS, ALL = 3, 2900
GAUSSIAN = ("gaussian_place", "gaussian_width")


class Run(NamedTuple):
    """One training; levels are the wavelet operator's."""

    network: str
    width: int
    levels: int | None = None
    samples: int = ALL


BASE = Run("wavelet", 16, 3)
PANELS = {
    "networks of equal size": [BASE, Run("Fourier", 10), Run("U-Net", 15)],
    "width": [BASE, Run("wavelet", 24, 3), Run("wavelet", 32, 3)],
    "levels": [Run("wavelet", 16, 2), BASE],
    "training samples": [BASE._replace(samples=440), BASE._replace(samples=1450), BASE],
}
"""Runs of the comparison, by panel."""
COLOURS = ("#0072B2", "#D55E00", "#009E73")


def measure(quick: bool) -> list[Record]:
    """A record for each run and modality."""
    import torch

    torch.set_num_threads(1)
    records = []
    for name in MODALITIES:
        training, validation = (DataSet.read(FOLDER / f"{name}_{split}.h5") for split in ("train", "validation"))
        every = list(dict.fromkeys(run for runs in PANELS.values() for run in runs))
        if quick:
            training, validation = spread(training, 70), spread(validation, 14)
            every = [run._replace(samples=70) for run in every if run.samples == ALL]
        records += [row(run, training, validation, 2 if quick else EPOCHS) for run in every]
    return records


def spread(data: DataSet, count: int) -> DataSet:
    """A subset of samples with the families in proportion."""
    rows = np.linspace(0, len(data) - 1, count).round().astype(int)
    return replace(data, **{key: getattr(data, key)[rows] for key in training_data.dataset.COLUMNS})


def network(run: Run) -> Any:
    """Constructor of the network from its input and output channels."""
    if run.network == "wavelet":
        return partial(operator.wavelet_operator.WaveletOperator, width=run.width, levels=run.levels)
    baselines = trainers.baselines
    return partial({"Fourier": baselines.FourierOperator, "U-Net": baselines.UNet}[run.network], width=run.width)


def row(run: Run, training: DataSet, validation: DataSet, epochs: int) -> Record:
    """Train with some of the samples, for as many maps as `epochs` of all, and validate."""
    epochs = round(epochs * len(training) / run.samples)
    begun = time.process_time()
    curve: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        some = spread(training, run.samples)
        settings = trainers.training.Settings(epochs=epochs)
        model = trainers.training.train(network(run), some, validation, Path(folder), settings, curve.append)
    cpu = time.process_time() - begun
    first = modality(training.modality).answers[0]
    told = [{"maps": each["epoch"] * run.samples, **errors_of(each, first)} for each in curve]
    made: Record = {
        "method": f"ngbrain:{run.network}",
        "order": 0,
        "ndof": operator.wavelet_operator.count_weights(model),
        "modality": training.modality,
    }
    made |= {**run._asdict(), "epochs": epochs, "error": gaussian(told[-1]), "errors": told[-1], "cpu_s": cpu}
    return made | {"converged": bool(np.isfinite(gaussian(told[-1]))), "curve": told}


def errors_of(epoch: dict[str, float], answer: str) -> dict[str, float]:
    """Errors by family."""
    prefix = f"{answer} "
    return {key.removeprefix(prefix): value for key, value in epoch.items() if key.startswith(prefix)}


def gaussian(errors: dict[str, float]) -> float:
    """Mean over the Gaussian families."""
    return float(np.mean([errors[family] for family in GAUSSIAN]))


def chart(records: list[Record], png: str) -> None:
    """Validation error over maps seen: a row for each modality, a panel for each thing that is changed and was measured."""
    modalities = list(dict.fromkeys(r["modality"] for r in records))
    most = max(r["samples"] for r in records)
    known = {Run(*(r[key] for key in Run._fields)) for r in records}
    panels = {title: [run._replace(samples=min(run.samples, most)) for run in runs] for title, runs in PANELS.items()}
    panels = {title: runs for title, runs in panels.items() if len(known.intersection(runs)) > 1}
    plt, made, grid = figure(4 * len(panels), 3.6 * len(modalities), len(panels), len(modalities), squeeze=False)
    for line_of, name in zip(grid, modalities, strict=True):
        done = {Run(*(r[key] for key in Run._fields)): r for r in records if r["modality"] == name}
        for axes, (title, runs) in zip(line_of, panels.items(), strict=True):
            shown = [(done[run], colour) for run, colour in zip(runs, COLOURS, strict=False) if run in done]
            if len(shown) < 2:
                axes.set_axis_off()
                continue
            for r, colour in shown:
                maps, errors = zip(*((each["maps"] / 1000, 100 * gaussian(each)) for each in r["curve"]), strict=True)
                axes.plot(maps, errors, ".-", color=colour, label=f"{label(title, r)}: {100 * r['error']:.1f} %")
            axes.set(xlabel="thousand maps seen", yscale="log", title=f"{name}: {title}")
            axes.set_ylabel("error, Gaussian spots, %")
            axes.grid(True, which="both", alpha=0.25)
            axes.legend(fontsize=8)
    made.savefig(png, dpi=130)
    plt.close(made)


def label(panel: str, r: Record) -> str:
    """Distinguishing label of a run in a panel."""
    size = f"{r['ndof'] / 1000:.0f} 000 weights"
    return {
        "networks of equal size": f"{r['network']}, {size}, {r['cpu_s'] / 60:.0f} min",
        "width": f"{r['width']}, {size}",
        "levels": f"{r['levels']}, {size}",
    }.get(panel, f"{r['samples']}")


def line(r: Record) -> str:
    """One record as text."""
    errors = ", ".join(f"{name} {100 * value:.2f} %" for name, value in r["errors"].items() if name != "maps")
    text = f"{r['modality']} {r['network']}, width {r['width']}, levels {r['levels']}, {r['samples']} samples"
    return f"{text}, {r['ndof']} weights, {r['epochs']} epochs, {r['cpu_s']:.0f} s: {100 * r['error']:.2f} %; {errors}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
