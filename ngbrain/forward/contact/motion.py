"""Prescribed motion of rigid bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class Motion(Protocol):
    """Prescribed motion of rigid bodies over time."""

    @property
    def events(self) -> Sequence[float]:
        """Times (s) at which the motion changes; time steps end on them. The last one ends the run."""

    def set(self, t: float) -> None:
        """Move the bodies to their position at time t (s)."""

    def travel(self, start: float, end: float) -> float:
        """Travel (m) towards the tissue between two times; negative on withdrawal.

        Parameters
        ----------
        start, end : float
            Times (s).

        Returns
        -------
        float
        """
