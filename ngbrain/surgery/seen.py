"""What was measured in a retraction: how landmarks moved, and the force of the blade; from arrays or from tables."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ngbrain.errors import InputError
from ngbrain.inverse.misfit import LeastSquares

Array = np.ndarray
LANDMARKS = ("t_s", "x_mm", "y_mm", "z_mm", "ux_mm", "uy_mm", "uz_mm")
"""Columns of a table of landmarks: when, where it was before, and by how much it has moved,"""
FORCE = ("t_s", "force_N")
"""and of one of forces."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What was measured in a retraction; NaN where it was not.

    times          (m,) s since it began
    landmarks      (n, 3) m, where they were before
    displacements  (m, n, 3) m
    force          (m,) N that the blade puts on the wall it pushes, across the cleft
    sigma          standard deviations of a displacement (m) and of the force (N)

    `Seen.read` takes it from tables. Raises `InputError` for shapes that do not fit together, a σ that is not positive, nothing
    measured.

    >>> Seen(np.array([60.0]), np.zeros((4, 3)), np.zeros((1, 4, 3)), np.array([0.3]), (2e-4, 0.01)).data.shape
    (1, 13)
    """

    times: Array
    landmarks: Array
    displacements: Array
    force: Array
    sigma: tuple[float, float]

    def __post_init__(self) -> None:
        times, landmarks = np.asarray(self.times, float), np.asarray(self.landmarks, float)
        m, n = len(times), len(landmarks)
        for name, value, shape in (
            ("landmarks", landmarks, (n, 3)),
            ("displacements", self.displacements, (m, n, 3)),
            ("force", self.force, (m,)),
        ):
            if np.shape(value) != shape:
                raise InputError(f"Seen.{name}", f"of shape {np.shape(value)}", f"{shape}: times and landmarks say so")
        if not all(sigma > 0 for sigma in self.sigma):
            raise InputError("Seen.sigma", self.sigma, "two positive standard deviations (m, N)")
        if np.all(np.isnan(self.data)):
            raise InputError("Seen", "nothing but NaN", "displacements or forces")

    @property
    def data(self) -> Array:
        """(m, 3n + 1), forces last."""
        return np.column_stack([np.reshape(self.displacements, (len(self.times), -1)), self.force])

    def misfit(self, times: float = 1.0) -> LeastSquares:
        """Its weighted squares, with standard deviations so many times as large."""
        sigma = np.append(np.full(3 * len(self.landmarks), self.sigma[0]), self.sigma[1])
        return LeastSquares(self.data, times * sigma)

    @classmethod
    def read(
        cls, landmarks: str | Path | None, force: str | Path | None, sigma_mm: float = 1.0, sigma_N: float = 1.0
    ) -> Seen:
        """From tables (CSV) with the columns `LANDMARKS` and `FORCE`, in the coordinates of the head; either may be missing.

        A landmark is where it was before; what was not measured is left empty, or has no line. Raises `InputError` for columns
        that are missing, what is no number, a landmark or force that is there twice at one time, tables without a line.
        """
        moved = np.empty((0, 7)) if landmarks is None else _table(Path(landmarks), LANDMARKS, 4)
        pushed = np.empty((0, 2)) if force is None else _table(Path(force), FORCE, 1)
        times = np.unique(np.concatenate([moved[:, 0], pushed[:, 0]]))
        places, which = np.unique(moved[:, 1:4], axis=0, return_inverse=True)
        displacements = np.full((len(times), len(places), 3), np.nan)
        displacements[np.searchsorted(times, moved[:, 0]), np.ravel(which)] = moved[:, 4:] / 1000
        forces = np.full(len(times), np.nan)
        forces[np.searchsorted(times, pushed[:, 0])] = pushed[:, 1]
        return cls(times, places / 1000, displacements, forces, (sigma_mm / 1000, sigma_N))


def _table(path: Path, columns: tuple[str, ...], keys: int) -> Array:
    """Its rows; the first so many columns say what a row is of."""
    rows, lines = [], dict[tuple[float, ...], int]()
    with path.open(newline="", encoding="utf-8-sig") as stream:
        reader = csv.DictReader(stream, skipinitialspace=True)
        given = [name.strip() for name in reader.fieldnames or ()]
        if absent := [name for name in columns if name not in given]:
            raise InputError(
                "columns", ", ".join(given) or "none", f"{', '.join(columns)}: {absent[0]} is missing", path
            )
        reader.fieldnames = given
        for row in reader:
            values = [_number(row[name], name, reader.line_num, path, i >= keys) for i, name in enumerate(columns)]
            key = tuple(values[:keys])
            if key in lines:
                raise InputError(
                    f"line {reader.line_num}", f"of what line {lines[key]} is of", "one line for each", path
                )
            lines[key] = reader.line_num
            rows.append(values)
    if not rows:
        raise InputError("table", "without a line", f"lines of {', '.join(columns)}", path)
    return np.array(rows)


def _number(text: str | None, column: str, line: int, path: Path, optional: bool) -> float:
    if optional and not (text or "").strip():
        return math.nan
    try:
        value = float(text or "")
    except ValueError:
        value = math.inf
    if not math.isfinite(value) and not (optional and math.isnan(value)):
        raise InputError(f"line {line}, {column}", repr(text), "a number", path)
    return value
