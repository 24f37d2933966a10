# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""Moduli of normal tissue at the frequencies of elastography: what a patient's are compared with, as data."""

from __future__ import annotations

import math
import re
from dataclasses import MISSING, dataclass
from importlib import resources
from pathlib import Path

from ngbrain.errors import InputError, nearest
from ngbrain.schema.document import Document, Section
from ngbrain.schema.fields import number, pattern, table, text

PREFIX = "norm_"
"""Beginning of the names of shipped norm files."""


@dataclass(frozen=True, kw_only=True)
class NormalTissue(Section):
    """The magnitude of the complex shear modulus of one tissue of healthy people.

    Parameters
    ----------
    region
        Name of the tissue, or a regular expression.
    modulus
        |G*| at `frequency`, the geometric mean over the tissue.
    frequency
        Of the measurement.
    loss_tangent
        G″/G′; at another frequency the modulus goes with its power 2/π atan(G″/G′), that of a spring-pot.
    power_deviation
        One standard deviation of that power.
    person_factor
        One standard deviation from person to person, as a factor.
    """

    KEY = "tissue"

    region: str = pattern("region")
    modulus: float = number("modulus_Pa", MISSING)
    frequency: float = number("frequency_Hz", 50.0)
    loss_tangent: float = number("loss_tangent", 0.0, least=0.0)
    power_deviation: float = number("power_deviation", 0.1, least=0.0)
    person_factor: float = number("person_factor", 1.15, least=1.0)

    @property
    def power(self) -> float:
        """Exponent of the frequency."""
        return 2 / math.pi * math.atan(self.loss_tangent)

    def modulus_at_frequency(self, frequency: float) -> float:
        """|G*| (Pa) at a frequency (Hz).

        >>> round(NormalTissue(region="white", modulus=2000.0, loss_tangent=1.0).modulus_at_frequency(200.0))
        4000
        """
        return self.modulus * (frequency / self.frequency) ** self.power

    def deviation(self, frequency: float) -> float:
        """Standard deviation of ln |G*| at a frequency (Hz), from that of the power."""
        return self.power_deviation * abs(math.log(frequency / self.frequency))


@dataclass(frozen=True, kw_only=True)
class Norm(Document):
    """Normal tissues, and the frequencies at which they may be compared.

    Parameters
    ----------
    title, source
        A line each.
    frequencies
        Lowest and highest frequency.
    tissues
        The first one whose region matches counts.
    """

    title: str = text("title", "", "one line of text", lambda raw: True)
    source: str = text("source", "", "one line of text", lambda raw: True)
    frequencies: tuple[float, float] = number("frequencies_Hz", MISSING, size=2)
    tissues: tuple[NormalTissue, ...] = table(NormalTissue, size=0)

    @classmethod
    def named(cls, name: str) -> Norm:
        """A norm by the path of its file, or a shipped one by its name.

        >>> Norm.named("brain").tissue("white").modulus_at_frequency(50.0)
        2650.0
        """
        if name.endswith(".toml"):
            return cls.from_toml(name)
        files = {
            Path(each.name).stem.removeprefix(PREFIX): each for each in resources.files("ngbrain.samples").iterdir()
        }
        known = {key: each for key, each in files.items() if each.name == f"{PREFIX}{key}.toml"}
        if name not in known:
            raise InputError("norm", repr(name), f"the path of a norm file (.toml), or {nearest(name, list(known))}")
        with resources.as_file(known[name]) as path:
            return cls.from_toml(path)

    def tissue(self, name: str) -> NormalTissue | None:
        """The normal tissue of a tissue's name; None where there is none, as of fluid."""
        return next((each for each in self.tissues if re.fullmatch(each.region, name)), None)

    def check_frequency(self, frequency: float) -> None:
        """Raise `InputError` for a frequency (Hz) without a norm."""
        low, high = self.frequencies
        if not low <= frequency <= high:
            wanted = f"{low:g} to {high:g} Hz, at which the norm {self.title!r} is known"
            raise InputError("stiffness.frequency_Hz", f"{frequency:g}", wanted)
