"""Measurements of a retraction: displacements of landmarks and the force of the blade, from arrays or CSV tables."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ngbrain.arguments import numbers
from ngbrain.errors import InputError
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.look import BriefText
from ngbrain.reading import read_table

Array = np.ndarray
LANDMARKS = ("t_s", "x_mm", "y_mm", "z_mm", "ux_mm", "uy_mm", "uz_mm")
"""Columns of a landmark table: time, position before retraction, displacement."""
FORCE = ("t_s", "force_N")
"""Columns of a force table."""
LARGEST = {"_mm": 1000.0, "_N": 1000.0, "_s": 1e7}
"""Suffix of a column name → number beyond which its unit must be wrong."""


@dataclass(frozen=True, eq=False, repr=False)
class Observations(BriefText):
    """Measurements of a retraction; missing values are NaN.

    Parameters
    ----------
    times : (m,) array
        Times (s) since the start, increasing.
    landmarks : (n, 3) array
        Landmark positions (m) before retraction.
    displacements : (m, n, 3) array
        Displacements (m) of the landmarks.
    force : (m,) array
        Force (N) of the blade on the wall that it pushes, across the cleft.
    sigma : tuple of float
        Standard deviations of a displacement (m) and of the force (N).

    Raises
    ------
    InputError
        Shapes that do not match, standard deviations that are not positive, or no measurement at all.

    Examples
    --------
    >>> Observations(np.array([60.0]), np.zeros((4, 3)), np.zeros((1, 4, 3)), np.array([0.3]), (2e-4, 0.01)).data.shape
    (1, 13)
    """

    times: Array
    landmarks: Array
    displacements: Array
    force: Array
    sigma: tuple[float, float]

    def __post_init__(self) -> None:
        times = numbers("Observations.times", self.times, (None,), "growing times (s) of at least 0")
        landmarks = numbers("Observations.landmarks", self.landmarks, (None, 3), "finite positions (n, 3), m")
        sigma = numbers("Observations.sigma", self.sigma, (2,), "two positive standard deviations (m, N), finite")
        m, n = len(times), len(landmarks)
        for name, value, shape in (
            ("landmarks", landmarks, (n, 3)),
            ("displacements", self.displacements, (m, n, 3)),
            ("force", self.force, (m,)),
        ):
            found = getattr(value, "shape", None)
            if found != shape or value.dtype.kind not in "iuf":
                wanted = f"an array of numbers of shape {shape}, as given by times and landmarks"
                raise InputError(f"Observations.{name}", f"of shape {found}" if found else type(value).__name__, wanted)
        if not np.all(times >= 0) or not np.all(np.diff(times) > 0):
            raise InputError("Observations.times", times, "growing times (s) of at least 0")
        if np.isinf(self.data).any():
            raise InputError("Observations", "infinite", "finite numbers; measurements may be NaN where there is none")
        if not np.all(sigma > 0):
            raise InputError("Observations.sigma", self.sigma, "two positive standard deviations (m, N), finite")
        if np.all(np.isnan(self.data)):
            raise InputError("Observations", "nothing but NaN", "displacements or forces")

    @property
    def data(self) -> Array:
        """All measurements, (m, 3n + 1); the force is the last column."""
        return np.column_stack([np.reshape(self.displacements, (len(self.times), -1)), self.force])

    def misfit(self, times: float = 1.0) -> LeastSquares:
        """Weighted least-squares misfit, with all standard deviations multiplied by `times`."""
        sigma = np.append(np.full(3 * len(self.landmarks), self.sigma[0]), self.sigma[1])
        return LeastSquares(self.data, times * sigma)

    @classmethod
    def read(
        cls, landmarks: str | Path | None, force: str | Path | None, sigma_mm: float = 1.0, sigma_N: float = 1.0
    ) -> Observations:
        """Read CSV tables in the coordinates of the head, with the columns `LANDMARKS` and `FORCE`.

        A value that was not measured is an empty cell, or its row is missing.

        Parameters
        ----------
        landmarks, force : str or Path, optional
            The tables; either may be None.
        sigma_mm, sigma_N : float
            Standard deviations of a displacement (mm) and of the force (N).

        Returns
        -------
        Observations

        Raises
        ------
        InputError
            Missing columns, cells that are no numbers, repeated rows, or tables without rows.
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
    """Rows of a table; the first `keys` columns identify a row, and the first column is an increasing time."""
    given, found, mark = read_table(path, "table")
    rows, lines, last = list[list[float]](), dict[tuple[float, ...], int](), dict[tuple[float, ...], float]()
    places = _places(given, columns, path)
    for line, cells in found:
        values = [_number(cells[at], columns[i], line, path, i >= keys, mark == ";") for i, at in enumerate(places)]
        key = tuple(values[:keys])
        if key in lines:
            raise InputError(f"line {line}", f"a repetition of line {lines[key]}", "one line for each", path)
        if not values[0] >= last.get(key[1:], 0.0):
            wanted = "a time (s) of at least 0, not before those in the lines above"
            raise InputError(f"line {line}, {columns[0]}", cells[places[0]], wanted, path)
        lines[key], last[key[1:]] = line, values[0]
        rows.append(values)
    if not rows:
        raise InputError("table", "without a row", f"rows of {', '.join(columns)}", path)
    table = np.array(rows)
    if np.isnan(table[:, keys:]).all():
        raise InputError("table", f"without a number in {', '.join(columns[keys:])}", "at least one number", path)
    return table


def _places(given: list[str], columns: tuple[str, ...], path: Path) -> list[int]:
    """Indices of the columns."""
    shown = ", ".join(given)[:200] or "none"
    if absent := [name for name in columns if name not in given]:
        raise InputError("columns", shown, f"{', '.join(columns)}: {absent[0]} is missing", path)
    if twice := [name for name in columns if given.count(name) > 1]:
        raise InputError("columns", shown, f"each of them once: {twice[0]} is there twice", path)
    return [given.index(name) for name in columns]


def _number(text: str, column: str, line: int, path: Path, optional: bool, comma: bool) -> float:
    """A finite number within the plausible range of its unit; a decimal comma is allowed where commas do not separate columns."""
    plain = (text.replace(",", ".") if comma else text).strip()
    if optional and plain.lower() in ("", "nan"):
        return math.nan
    try:
        value = float(plain) if "_" not in plain else math.inf
    except ValueError:
        value = math.inf
    where, most = f"line {line}, {column}", next(m for end, m in LARGEST.items() if column.endswith(end))
    if not math.isfinite(value):
        raise InputError(where, repr(text[:60]), "a number", path)
    if not abs(value) <= most:
        raise InputError(where, f"{value:g}", f"at most {most:g} in that unit", path)
    return value
