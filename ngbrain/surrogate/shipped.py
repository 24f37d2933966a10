"""Trained weights as they are shipped: an ONNX graph, run by onnxruntime on one core, and a card that says what made it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import InputError, naming, require
from ngbrain.surrogate.features import MODALITIES, Modality, modality

Array = np.ndarray
WEIGHTS = Path(__file__).parent / "weights"
BATCH = 16
"""Squares that are answered at a time: more of them are no faster on one core."""


@dataclass(frozen=True, eq=False)
class Card:
    """What NAME.json says beside the weights.

    told  all of it: command, settings, data and curve of the training; what `trust.calibrate` found
    """

    told: Mapping[str, Any]

    @staticmethod
    def read(path: Path) -> Card:
        """`InputError` where it is missing or no card."""
        with naming(path):
            try:
                told = json.loads(path.read_text())
            except (OSError, ValueError) as error:
                raise InputError(
                    "card", f"unreadable ({error})", "what a training has written beside its weights"
                ) from error
            if not isinstance(told, dict) or told.get("modality") not in MODALITIES:
                raise InputError("card", "of no modality", f"`modality`, one of {', '.join(MODALITIES)}")
        return Card(told)

    @property
    def kind(self) -> Modality:
        """What the operator looks at."""
        return modality(self.told["modality"])

    @property
    def temperature(self) -> Array:
        """(answers,): what a scale is multiplied by; 1 before calibration."""
        return np.asarray(self.told.get("temperature", np.ones(len(self.kind.answers))))

    def within(self, share: float) -> Array:
        """(answers,): how many standard deviations hold that share of errors, by calibration; between its shares linear.

        Raises `InputError` before calibration, and for a share beyond those that it has seen.
        """
        told = self.told.get("within")
        if told is None:
            raise InputError("card", "without `within`", "weights that `ngbrain.surrogate.trust.calibrate` has seen")
        least, most = told["shares"][0], told["shares"][-1]
        if not least <= share <= most:
            raise InputError("share", share, f"{least:g} to {most:g}, as the operator is calibrated")
        return np.array([np.interp(share, told["shares"], of_answer) for of_answer in told["deviations"]])

    @property
    def trust(self) -> Mapping[str, Any]:
        """What `trust.calibrate` found; `InputError` before it has."""
        if "trust" not in self.told:
            raise InputError("card", "without trust", "weights that `ngbrain.surrogate.trust.calibrate` has seen")
        return dict(self.told["trust"])


@dataclass(frozen=True, eq=False)
class Operator:
    """Features to ln of moduli (and loss over storage), and the standard deviation of each."""

    card: Card
    session: Any

    @staticmethod
    @cache
    def shipped(name: str) -> Operator:
        """The operator of a modality that comes with the package; errors as `of`.

        >>> Operator.shipped("wave")
        Traceback (most recent call last):
        ngbrain.errors.InputError: modality is 'wave'; wanted: did you mean 'waves'?
        """
        return Operator.of(WEIGHTS, modality(name).name)

    @staticmethod
    def of(folder: Path, name: str) -> Operator:
        """NAME.onnx and NAME.json of a folder. Raises `InputError` where there are none, `MissingExtra` without onnxruntime."""
        runtime = require("onnxruntime", "surrogate")
        weights = folder / f"{name}.onnx"
        if not weights.is_file():
            raise InputError("weights", "missing", "what `python -m ngbrain.surrogate` has written", weights)
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        session = runtime.InferenceSession(str(weights), options, providers=["CPUExecutionProvider"])
        return Operator(Card.read(weights.with_suffix(".json")), session)

    @property
    def kind(self) -> Modality:
        """What it looks at."""
        return self.card.kind

    def __call__(self, features: Array) -> tuple[Array, Array]:
        """Features (batch, channels, n, n) → means and standard deviations (batch, answers, n, n), calibrated, doubles."""
        parts = [
            self.session.run(["mean", "scale"], {"features": features[first : first + BATCH]})
            for first in range(0, len(features), BATCH)
        ]
        mean, scale = (np.concatenate(each).astype(float) for each in zip(*parts, strict=True))
        return mean, np.exp(scale) * self.card.temperature[:, None, None]
