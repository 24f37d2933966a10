"""Training: new noise, symmetries and phases in every epoch, normalisation from training data alone, a checkpoint per epoch.

The operator predicts a mean m and a scale s for every point of ln(modulus) and, for waves, G″/G′. With the truth t

    loss = Σ_samples ln(‖exp m - exp t‖/‖exp t‖ + ε)  (storage; loss with half the weight)  +  w mean(((t - m̄)/s)²/2 + ln s)

Logarithms give a relative improvement of a smooth square the same weight as one of a square with edges, whose
errors are three times larger. With them and batches of 8, smooth squares were 17 % and inclusions 9 % better after
four passes than without them and with batches of 16. m̄ is m without gradient, so that scales learn the size of
errors and do not influence the means.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, nearest
from ngbrain.io.json_file import write_json
from ngbrain.look import BriefText
from ngbrain.progress import log_progress, reporting
from ngbrain.surrogate.data.dataset import DENSITY, DataSet
from ngbrain.surrogate.operator.encoding import NOISE, Modality, add_noise, modality, relative_errors
from ngbrain.surrogate.operator.symmetries import apply_random_symmetry
from ngbrain.surrogate.training.optimisers import Descent

Array = np.ndarray
FLOOR = 0.003
"""ε: smaller errors have little effect."""
OF_SCALES = 0.15
"""Weight w."""
LOSSLESS = 0.05
"""Fraction of the storage modulus added to the norm of the loss modulus, which is zero for lossless bodies."""
NARROW = -7.0
"""Smallest ln of a scale."""


@dataclass(frozen=True)
class Settings:
    """Settings of a training.

    Parameters
    ----------
    epochs : int, default 60
        Passes over the data.
    batch : int, default 8
        Samples per step.
    rate : float, default 0.02
        Highest learning rate, see `Descent`.
    noise : tuple of (float, float), default NOISE
        Range of the relative noise, log-uniform; its correlation length is that of the modality.
    seed : int, default 0
        Seed of all random numbers.
    twice : tuple of str, default ()
        Families that appear twice as often as others, in as many steps.
    """

    epochs: int = 60
    batch: int = 8
    rate: float = 0.02
    noise: tuple[float, float] = NOISE
    seed: int = 0
    twice: tuple[str, ...] = ()


class Surrogate(nn.Module):
    """Network between its normalisations: input channels → means and ln of scales (batch, answers, n, n).

    Parameters
    ----------
    operator : nn.Module
        Network from `Modality.channels` to twice the number of answers.
    kind : Modality
        Modality; the network corrects its `estimates` where it has some, else the mean.
    """

    def __init__(self, operator: nn.Module, kind: Modality) -> None:
        super().__init__()
        channels, answers = kind.channels, len(kind.answers)
        self.operator, self.answers, self.estimates = operator, answers, kind.estimates
        for name, size in (("centre", channels), ("spread", channels), ("middle", answers), ("width", answers)):
            self.register_buffer(name, torch.ones(1, size, 1, 1))

    def fit(self, features: Array, targets: Array) -> None:
        """Set the normalisation to mean and standard deviation of training data.

        Parameters
        ----------
        features : numpy.ndarray of shape (batch, channels, n, n)
            Input channels.
        targets : numpy.ndarray of shape (batch, answers, n, n)
            Targets.
        """
        for mean, deviation, values in (("centre", "spread", features), ("middle", "width", targets)):
            over = (0, 2, 3)
            getattr(self, mean).copy_(torch.from_numpy(values.mean(axis=over, keepdims=True)))
            getattr(self, deviation).copy_(torch.from_numpy(values.std(axis=over, keepdims=True) + 1e-6))

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Means and ln of scales."""
        out = self.operator((features - self.centre) / self.spread)
        mean, scale = out[:, : self.answers], out[:, self.answers :]
        first = features[:, self.estimates] if self.estimates else self.middle
        return mean * self.width + first, torch.clamp(scale, NARROW, 3.0) + torch.log(self.width)


def objective(mean: torch.Tensor, scale: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
    """Loss of the training, averaged over the batch; see the module.

    Parameters
    ----------
    mean : torch.Tensor
        Means, of shape (batch, answers, n, n).
    scale : torch.Tensor
        ln of scales, of the same shape.
    targets : torch.Tensor
        Targets, of the same shape.

    Returns
    -------
    torch.Tensor
        The loss.
    """
    found, true = torch.exp(mean[:, 0]), torch.exp(targets[:, 0])
    size = true.flatten(1).norm(dim=1)
    total = torch.log((found - true).flatten(1).norm(dim=1) / size + FLOOR).mean()
    if targets.shape[1] == 2:
        lossy = true * targets[:, 1]
        off = (found * mean[:, 1] - lossy).flatten(1).norm(dim=1) / (lossy.flatten(1).norm(dim=1) + LOSSLESS * size)
        total = total + 0.5 * torch.log(off + FLOOR).mean()
    likely = (((targets - mean.detach()) * torch.exp(-scale)) ** 2 / 2 + scale).mean()
    return total + OF_SCALES * likely


@dataclass(frozen=True, eq=False, repr=False)
class Learner(BriefText):
    """Data set with its targets, as a source of training batches.

    Parameters
    ----------
    data : DataSet
        The data.
    kind : Modality
        Modality.
    maps : numpy.ndarray of shape (samples, answers, n, n)
        Targets.
    """

    data: DataSet
    kind: Modality
    maps: Array

    @staticmethod
    def from_data(data: DataSet) -> Learner:
        """Compute the targets of a data set."""
        kind = modality(data.modality)
        unit = kind.unit(data.storage, data.frequency, DENSITY, data.side)
        return Learner(data, kind, kind.targets(data.storage, data.loss, unit))

    def draw_batch(self, rows: Array, noise: tuple[float, float], random: np.random.Generator) -> tuple[Array, Array]:
        """Input channels and targets of samples, with random symmetries and noise.

        Parameters
        ----------
        rows : numpy.ndarray
            Numbers of the samples.
        noise : tuple of (float, float)
            Range of the relative noise.
        random : np.random.Generator
            Random numbers.

        Returns
        -------
        tuple of (numpy.ndarray, numpy.ndarray)
            Input channels and targets.
        """
        u, maps = apply_random_symmetry(self.data.modality, self.data.displacement[rows], self.maps[rows], random)
        sigma = np.exp(random.uniform(np.log(noise[0]), np.log(noise[1]), len(rows)))
        return self.kind.features(self.kind.add_noise(u, sigma, random), self.data.poisson[rows]), maps

    def noisy_features(self, noise: float, seed: int = 0) -> Array:
        """Input channels of all samples, without symmetries, with white noise.

        Parameters
        ----------
        noise : float
            Relative noise.
        seed : int, default 0
            Seed of the noise.

        Returns
        -------
        numpy.ndarray
            Input channels.
        """
        random = np.random.default_rng(seed)
        u = add_noise(self.data.displacement, np.full(len(self.data), noise), random)
        return self.kind.features(u, self.data.poisson)


@reporting()
def train(
    operator: Callable[[int, int], nn.Module],
    training: DataSet,
    validation: DataSet,
    folder: Path,
    settings: Settings = Settings(),
    callback: Callable[[dict[str, float]], None] = log_progress,
    start: Path | None = None,
) -> Surrogate:
    """Train an operator, or resume from the checkpoint in the folder.

    After every epoch checkpoint.pt and curve.json are written; the latter has a record per epoch: the objective,
    and validation errors at 1 % noise.

    Parameters
    ----------
    operator : callable
        Makes the network from its numbers of input and output channels.
    training : DataSet
        Training data.
    validation : DataSet
        Validation data.
    folder : pathlib.Path
        Folder of the checkpoint.
    settings : Settings, default Settings()
        Settings.
    callback : callable, default log_progress
        Called with the record of each epoch.
    start : pathlib.Path, optional
        Checkpoint of an earlier training on the same data; this training continues its weights and its curve.

    Returns
    -------
    Surrogate
        The trained surrogate.

    Raises
    ------
    InputError
        Data of two modalities or without a family of `twice`, a checkpoint of other settings, or a start of other
        data.
    """
    if training.modality != validation.modality:
        raise InputError("validation", f"of {validation.modality}", f"{training.modality}, as the training data are")
    for name in settings.twice:
        if name not in training.names:
            raise InputError("twice", repr(name), nearest(name, list(training.names)))
    learner, monitor = Learner.from_data(training), Learner.from_data(validation)
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(settings.seed)
    kind, random = learner.kind, np.random.default_rng(settings.seed)
    model = Surrogate(operator(kind.channels, 2 * len(kind.answers)), kind)
    model.fit(*learner.draw_batch(random.permutation(len(training))[:512], settings.noise, random))
    steps = settings.epochs * (len(training) // settings.batch)
    descent = Descent(model, settings.rate, steps)
    curve: list[dict[str, float]] = []
    made_by: dict[str, Any] = json.loads(json.dumps({**asdict(settings), "data": training.sha256}))
    if start is not None:
        first = torch.load(start, weights_only=True)
        if first["made_by"]["data"] != training.sha256:
            raise InputError("start", f"of the data {first['made_by']['data'][:8]}", f"of {training.sha256[:8]}")
        model.load_state_dict(first["model"])
        curve = first["curve"]
        made_by["start"] = first["made_by"]
    last = len(curve) + settings.epochs
    checkpoint = folder / "checkpoint.pt"
    if checkpoint.exists():
        saved = torch.load(checkpoint, weights_only=True)
        if saved["made_by"] != made_by:
            raise InputError("checkpoint.pt", saved["made_by"], f"{made_by}, or another folder")
        model.load_state_dict(saved["model"])
        descent.load_state_dict(saved["descent"])
        curve = saved["curve"]
    seen = monitor.noisy_features(0.01)
    again = np.isin(training.family, [training.names.index(name) for name in settings.twice])
    shown = np.concatenate([np.arange(len(training)), np.flatnonzero(again)])
    for epoch in range(len(curve), last):
        random = np.random.default_rng([settings.seed, epoch])
        order = random.permutation(shown)[: len(training)]
        batches = [order[i : i + settings.batch] for i in range(0, len(order) - settings.batch + 1, settings.batch)]
        losses = []
        model.train()
        for features, targets in _prefetch(learner, batches, settings.noise, random):
            mean, scale = model(torch.from_numpy(features))
            value = objective(mean, scale, torch.from_numpy(targets))
            if descent.step(value):
                losses.append(value.item())
        off = relative_errors(predict_batches(model, seen)[0], monitor.maps)
        curve.append({"epoch": epoch + 1, "objective": float(np.mean(losses)), **_means(off, monitor)})
        states = {"model": model.state_dict(), "descent": descent.state_dict()}
        atomic_write(checkpoint, partial(torch.save, {**states, "curve": curve, "made_by": made_by}))
        write_json(folder / "curve.json", curve)
        callback(curve[-1])
    return model


def _prefetch(
    learner: Learner, batches: Sequence[Array], noise: tuple[float, float], random: np.random.Generator
) -> Iterator[tuple[Array, Array]]:
    """Training batches, the next one prepared in a thread while one is used."""
    with ThreadPoolExecutor(1) as beside:
        coming = [beside.submit(learner.draw_batch, batches[0], noise, random)]
        for rows in (*batches[1:], None):
            here = coming.pop().result()
            if rows is not None:
                coming.append(beside.submit(learner.draw_batch, rows, noise, random))
            yield here


def predict_batches(model: Surrogate, features: Array, batch: int = 25) -> tuple[Array, Array]:
    """Means and standard deviations for many samples.

    Parameters
    ----------
    model : Surrogate
        The surrogate.
    features : numpy.ndarray of shape (samples, channels, n, n)
        Input channels.
    batch : int, default 25
        Samples at a time.

    Returns
    -------
    tuple of (numpy.ndarray, numpy.ndarray)
        Means and standard deviations, each of shape (samples, answers, n, n).
    """
    model.eval()
    with torch.no_grad():
        parts = [model(torch.from_numpy(features[i : i + batch])) for i in range(0, len(features), batch)]
    mean, scale = (torch.cat(each).numpy() for each in zip(*parts, strict=True))
    return mean, np.exp(scale)


def _means(off: Array, monitor: Learner) -> dict[str, float]:
    """Mean error of each answer, over all samples and by family."""
    found = {}
    for column, answer in enumerate(monitor.kind.answers):
        found[answer] = float(np.nanmean(off[:, column]))
        for i, name in enumerate(monitor.data.names):
            found[f"{answer} {name}"] = float(np.nanmean(off[monitor.data.family == i, column]))
    return found
