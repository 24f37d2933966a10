"""How rigid bodies move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class Motion(Protocol):
    """How the rigid bodies move."""

    @property
    def events(self) -> Sequence[float]:
        """Times (s) at which the motion changes; steps land on them exactly. The last one ends the run."""

    def set(self, t: float) -> None:
        """Put the bodies where they are at time t."""

    def travel(self, start: float, end: float) -> float:
        """How far (m) they move towards the tissue between two times; negative when they withdraw."""
