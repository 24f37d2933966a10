"""Shipped weights: an ONNX graph, run by onnxruntime on one core, and a model card that states how it was made."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import InputError, file_context, require
from ngbrain.reading import read_bytes, read_json
from ngbrain.schema.document import brief
from ngbrain.surrogate.operator.encoding import MODALITIES, Modality, modality

Array = np.ndarray
WEIGHTS = Path(__file__).parents[1] / "weights"
DIGEST = "onnx_sha256"
"""Key of the card with the SHA-256 of its weights."""
MOST_WEIGHTS = 2**28
"""Largest size of the weights (bytes)."""
BATCH = 16
"""Squares evaluated at a time; more are no faster on one core."""


@dataclass(frozen=True, eq=False)
class ModelCard:
    """Model card, NAME.json beside the weights.

    Parameters
    ----------
    content : dict of str to object
        All of it: command, settings, data and learning curve of the training; results of `trust.calibrate`.
    """

    content: Mapping[str, Any]

    @staticmethod
    def read(path: Path) -> ModelCard:
        """Read a card; raises `InputError` where it is missing or malformed."""
        with file_context(path):
            content = read_json(path, "card")
            if not isinstance(content, dict) or content.get("modality") not in MODALITIES:
                raise InputError("card", "of no modality", f"`modality`, one of {', '.join(MODALITIES)}")
            card = ModelCard(content)
            card.check()
        return card

    def check(self) -> None:
        """Raise `InputError` where the calibration results are malformed; they may be missing."""
        count, content = len(self.kind.answers), self.content
        wanted = "the output of `ngbrain.surrogate.prediction.trust.calibrate`"
        if "temperature" in content and not (
            _numbers(content["temperature"], (count,)) and np.all(self.temperature > 0)
        ):
            raise InputError("temperature", brief(content["temperature"]), f"{count} positive numbers")
        if "within" in content:
            within = content["within"] if isinstance(content["within"], dict) else {}
            shares = within.get("shares")
            if not (
                isinstance(shares, list)
                and len(shares) > 1
                and _numbers(shares, (len(shares),))
                and np.all(np.diff([0.0, *shares, 1.0]) > 0)
                and _numbers(within.get("deviations"), (count, len(shares)))
            ):
                raise InputError("within", brief(content["within"]), wanted)
        if "trust" in content:
            self._check_trust(wanted)

    def _check_trust(self, wanted: str) -> None:
        trust = self.content["trust"] if isinstance(self.content["trust"], dict) else {}
        ranges, bounds, axes = (trust.get(key) for key in ("ranges", "bounds", "axes"))
        known = {"frequency", "wavelength", "modulus"} if self.kind.name == "waves" else {"contrast"}
        if not (isinstance(ranges, dict) and known | {"softness"} == set(ranges)):
            raise InputError("trust.ranges", brief(ranges), wanted)
        for name, ends in ranges.items():
            one = name in ("softness", "frequency")
            if not (isinstance(ends, list) and _numbers(ends, (2,) if one else (2, 3))):
                raise InputError(f"trust.ranges.{name}", brief(ends), wanted)
        named = ("features", "deviation", "residual", "boundary", "noise")
        if not (isinstance(bounds, dict) and all(_positive(bounds.get(name)) for name in named)):
            raise InputError("trust.bounds", brief(bounds), wanted)
        if not _positive(trust.get("threshold")):
            raise InputError("trust.threshold", brief(trust.get("threshold")), wanted)
        lists = [axes.get(key) for key in ("mean", "variance")] if isinstance(axes, dict) else []
        sizes = [len(values) if isinstance(values, list) else 0 for values in lists]
        shapes = {"mean": sizes[:1], "spread": sizes[:1], "axes": sizes[::-1], "variance": sizes[1:]}
        if not isinstance(axes, dict) or 0 in sizes or not _positive(axes.get("across")):
            raise InputError("trust.axes", brief(axes), wanted)
        for key, shape in shapes.items():
            if not _numbers(axes.get(key), tuple(shape)) or (key in ("spread", "variance") and min(axes[key]) <= 0):
                raise InputError(f"trust.axes.{key}", brief(axes.get(key)), wanted)

    @property
    def kind(self) -> Modality:
        """Modality of the operator."""
        return modality(self.content["modality"])

    @property
    def temperature(self) -> Array:
        """(answers,): calibration factors of the standard deviations; 1 before calibration."""
        return np.asarray(self.content.get("temperature", np.ones(len(self.kind.answers))))

    def coverage_factors(self, share: float) -> Array:
        """(answers,): number of standard deviations that cover this share of the errors, linear between calibrated shares.

        Raises `InputError` before calibration, and for a share beyond the calibrated ones.
        """
        calibration = self.content.get("within")
        if calibration is None:
            raise InputError(
                "card", "without `within`", "weights calibrated by `ngbrain.surrogate.prediction.trust.calibrate`"
            )
        least, most = calibration["shares"][0], calibration["shares"][-1]
        if not least <= share <= most:
            raise InputError("share", share, f"{least:g} to {most:g}, as the operator is calibrated")
        return np.array([np.interp(share, calibration["shares"], row) for row in calibration["deviations"]])

    @property
    def trust(self) -> Mapping[str, Any]:
        """Ranges, bounds and threshold of `trust.calibrate`; raises `InputError` before calibration."""
        if "trust" not in self.content:
            raise InputError(
                "card", "without trust", "weights calibrated by `ngbrain.surrogate.prediction.trust.calibrate`"
            )
        return dict(self.content["trust"])


@dataclass(frozen=True, eq=False)
class Operator:
    """Trained operator: from input channels to the mean and standard deviation of ln of moduli (and loss over storage).

    Parameters
    ----------
    card : Card
        Model card.
    session : object
        Session of onnxruntime.
    """

    card: ModelCard
    session: Any

    @staticmethod
    @cache
    def load_default(name: str) -> Operator:
        """The shipped operator of a modality; raises the errors of `load`.

        >>> Operator.load_default("wave")
        Traceback (most recent call last):
        ngbrain.errors.InputError: modality is 'wave'; wanted: did you mean 'waves'?
        """
        return Operator.load(WEIGHTS, modality(name).name)

    @staticmethod
    def load(folder: Path, name: str) -> Operator:
        """Load NAME.onnx and NAME.json of a folder.

        Parameters
        ----------
        folder : pathlib.Path
            The folder.
        name : str
            NAME.

        Returns
        -------
        Operator
            The operator.

        Raises
        ------
        InputError
            A file is missing or malformed, or the card belongs to other weights.
        MissingExtra
            onnxruntime is not installed.
        """
        runtime = require("onnxruntime", "surrogate")
        weights = folder / f"{name}.onnx"
        card, raw = ModelCard.read(weights.with_suffix(".json")), read_bytes(weights, "weights", MOST_WEIGHTS)
        if card.content.get(DIGEST) != hashlib.sha256(raw).hexdigest():
            found = (
                "not those that the card was written for"
                if DIGEST in card.content
                else "without a digest in their card"
            )
            wanted = (
                f"those whose SHA-256 stands in the card as `{DIGEST}`, as `python -m ngbrain.surrogate` writes both"
            )
            raise InputError("weights", found, wanted, weights)
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            session = runtime.InferenceSession(raw, options, providers=["CPUExecutionProvider"])
            puts, gives = ({each.name for each in of} for of in (session.get_inputs(), session.get_outputs()))
        except Exception as error:  # onnxruntime has exceptions of its own, without a common base
            raise InputError(
                "weights", f"unreadable ({type(error).__name__}: {error})", "an ONNX graph", weights
            ) from error
        if puts != {"features"} or not {"mean", "scale"} <= gives:
            found = f"a graph from {', '.join(sorted(puts))} to {', '.join(sorted(gives))}"
            raise InputError("weights", found, "one from features to mean and scale", weights)
        return Operator(card, session)

    @property
    def kind(self) -> Modality:
        """Modality of the operator."""
        return self.card.kind

    def __call__(self, features: Array) -> tuple[Array, Array]:
        """Input channels (batch, channels, n, n) → calibrated means and standard deviations (batch, answers, n, n),
        double precision.
        """
        parts = [
            self.session.run(["mean", "scale"], {"features": features[first : first + BATCH]})
            for first in range(0, len(features), BATCH)
        ]
        mean, scale = (np.concatenate(each).astype(float) for each in zip(*parts, strict=True))
        return mean, np.exp(scale) * self.card.temperature[:, None, None]


def _numbers(values: Any, shape: tuple[int, ...]) -> bool:
    """Whether these are finite numbers in nested lists of that shape."""
    try:
        array = np.asarray(values)
    except ValueError:  # lists of unequal lengths
        return False
    return array.shape == shape and array.dtype.kind in "iuf" and bool(np.isfinite(array).all())


def _positive(value: Any) -> bool:
    return _numbers(value, ()) and value > 0
