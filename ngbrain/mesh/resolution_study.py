"""How much of the anatomy a question needs: which route and size, by what was measured on one head."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

TABLE = "detail.json"
"""The records of `benchmarks/mesh_routes.py`, a copy of `benchmarks/mesh_routes.json`."""
QUESTIONS: Mapping[str, tuple[str, str, str, float]] = {
    "mean pressure under a dent of 5 mm": ("pressure_error", "cpu_s", "ndof", 0.05),
    "95th percentile of the strain around it": ("strain_error", "cpu_s", "ndof", 0.05),
    "displacement in tissue by a wave of 50 Hz": ("wave_error", "wave_s", "wave_ndof", 0.1),
}
"""Question → keys of its difference, CPU time and unknowns in a record, and how exactly it is asked by itself."""


@dataclass(frozen=True)
class MeshRecommendation:
    """What a question needs.

    within       difference asked for, relative
    known        how well the finest mesh is itself known: its difference from the next finest, by unknowns
    enough       whether a mesh differs by no more than `within` - `known` from the finest one
    route, size  of the cheapest that does, else of the finest (m); order of its elements
    cpu_s        of mesh and solution; difference of that mesh
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
        """In a sentence."""
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
    """The cheapest mesh for one of `QUESTIONS`, by records of the benchmark (those that come with the library).

    Differences are from the finest mesh of all routes, so that what a route leaves out counts as what its elements do. A
    mesh does if its difference and that by which the finest mesh is known add up to no more than `within`. One head, MNI152,
    one site, one law of tissue: a guide, no bound.

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
    """Of all questions."""
    return tuple(map(recommend_mesh, QUESTIONS))
