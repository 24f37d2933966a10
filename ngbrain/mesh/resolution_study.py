"""Which meshing route and element size are fine enough for a quantity of interest, by measurements on one head."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

TABLE = "detail.json"
"""Records of `benchmarks/mesh_routes.py`, a copy of `benchmarks/mesh_routes.json`."""
QUESTIONS: Mapping[str, tuple[str, str, str, float]] = {
    "mean pressure under a dent of 5 mm": ("pressure_error", "cpu_s", "ndof", 0.05),
    "95th percentile of the strain around it": ("strain_error", "cpu_s", "ndof", 0.05),
    "displacement in tissue by a wave of 50 Hz": ("wave_error", "wave_s", "wave_ndof", 0.1),
}
"""Question → keys of its difference, CPU time and number of unknowns in a record, and its default tolerance."""


@dataclass(frozen=True)
class MeshRecommendation:
    """The cheapest mesh that is accurate enough for a quantity of interest.

    Parameters
    ----------
    question : str
        The quantity of interest, a key of `QUESTIONS`.
    tolerance : float
        Relative error allowed.
    reference_error : float
        Uncertainty of the reference: relative difference of the two finest meshes, by number of unknowns.
    adequate : bool
        Whether a mesh differs from the finest one by `tolerance` - `reference_error` at most.
    route : str
        Meshing route of the cheapest such mesh, else of the finest mesh.
    size : float
        Its element size (m).
    order : int
        Its polynomial order.
    cpu_s : float
        CPU time of mesh and solution (s).
    difference : float
        Relative difference of that mesh from the finest one.
    """

    question: str
    tolerance: float
    reference_error: float
    adequate: bool
    route: str
    size: float
    order: int
    cpu_s: float
    difference: float

    def __str__(self) -> str:
        """The recommendation as a sentence."""
        mesh = f"{self.route} of {1e3 * self.size:g} mm, order {self.order}"
        known = f"is known to {self.reference_error:.1%}"
        if self.adequate:
            found = f"{mesh} ({self.difference:.1%} from the finest, which {known}; {self.cpu_s:.0f} s)"
        else:
            found = f"finer than any mesh measured: the finest, {mesh}, {known} only ({self.cpu_s:.0f} s)"
        return f"{self.question} within {self.tolerance:.0%}: {found}"


@cache
def _records() -> tuple[dict, ...]:
    return tuple(json.loads(files("ngbrain.mesh").joinpath(TABLE).read_text()))


def recommend_mesh(
    question: str, tolerance: float | None = None, records: tuple[dict, ...] | None = None
) -> MeshRecommendation:
    """Recommend the cheapest mesh for a quantity of interest.

    Differences are from the finest mesh of all routes, so that they include what a route leaves out of the anatomy. A mesh is
    adequate if its difference plus the uncertainty of the finest mesh is at most the tolerance. The records are of one head
    (MNI152), one site and one material law: they are a guide, not a bound.

    Parameters
    ----------
    question : str
        A key of `QUESTIONS`.
    tolerance : float, optional
        Relative error allowed; None: that of the question.
    records : tuple of dict, optional
        Records of the benchmark; None: those shipped with the package.

    Returns
    -------
    MeshRecommendation
        The cheapest adequate mesh, else the finest one.

    Examples
    --------
    >>> rows = [("hull", 9, 0.03, 4.0, 100), ("lattice", 6, 0.01, 7.0, 200), ("lattice", 5, 0.0, 9.0, 300)]
    >>> keys = ("method", "size_mm", "pressure_error", "cpu_s", "ndof")
    >>> records = tuple(dict(zip(keys, row, strict=True)) | {"order": 2, "converged": True} for row in rows)
    >>> print(recommend_mesh("mean pressure under a dent of 5 mm", 0.05, records))
    mean pressure under a dent of 5 mm within 5%: hull of 9 mm, order 2 (3.0% from the finest, which is known to 1.0%; 4 s)
    """
    key, spent, unknowns, usual = QUESTIONS[question]
    tolerance = usual if tolerance is None else tolerance
    rows = [r for r in (records or _records()) if r["converged"] and r.get(key) is not None]
    rows.sort(key=lambda r: float(r[unknowns]))
    reference_error = float(rows[-2][key])
    adequate = [r for r in rows if r[key] + reference_error <= tolerance]
    best = min(adequate, key=lambda r: float(r[spent])) if adequate else rows[-1]
    return MeshRecommendation(
        question,
        tolerance,
        reference_error,
        bool(adequate),
        str(best["method"]).removeprefix("ngbrain:"),
        1e-3 * best["size_mm"],
        int(best["order"]),
        float(best[spent]),
        float(best[key]),
    )


def recommend_meshes() -> tuple[MeshRecommendation, ...]:
    """Recommendations for all questions."""
    return tuple(map(recommend_mesh, QUESTIONS))
