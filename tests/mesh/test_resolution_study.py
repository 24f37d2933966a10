"""Mesh recommendations: the shipped table and its evaluation."""

import json
from pathlib import Path

import pytest

from ngbrain.mesh import resolution_study
from ngbrain.mesh.resolution_study import QUESTIONS, recommend_mesh, recommend_meshes

BENCHMARK = Path(__file__).parents[2] / "benchmarks/mesh_routes.json"
PRESSURE, WAVE = "mean pressure under a dent of 5 mm", "displacement in tissue by a wave of 50 Hz"


def row(route, size, error, cpu_s, ndof):
    found = {
        "method": f"ngbrain:{route}",
        "size_mm": size,
        "order": 2,
        "pressure_error": error,
        "cpu_s": cpu_s,
        "ndof": ndof,
    }
    return found | {"converged": True}


ROWS = (
    row("conforming", 8, 0.0, 40.0, 900),
    row("hull", 10, 0.04, 8.0, 200),
    row("lattice", 9, 0.005, 9.0, 300),
    row("hull", 7, 0.01, 20.0, 700),
)


def test_the_table_is_the_benchmark_s():
    shipped = Path(resolution_study.__file__).with_name(resolution_study.TABLE)
    assert json.loads(shipped.read_text()) == json.loads(BENCHMARK.read_text())


@pytest.mark.parametrize(
    ("tolerance", "route", "size"),
    [(0.1, "hull", 10), (0.05, "hull", 10), (0.04, "lattice", 9), (0.015, "lattice", 9), (0.012, "conforming", 8)],
)
def test_the_cheapest_that_is_sure_to_do(tolerance, route, size):
    found = recommend_mesh(PRESSURE, tolerance, ROWS)
    assert found.adequate and (found.route, 1e3 * found.size, found.reference_error) == (
        route,
        pytest.approx(size),
        0.01,
    )
    assert f"{route} of {size} mm" in str(found)


def test_nothing_is_claimed_beyond_what_the_finest_is_known_to():
    found = recommend_mesh(PRESSURE, 0.009, ROWS)
    assert not found.adequate
    assert "finer than any mesh measured: the finest, conforming of 8 mm, order 2, is known to 1.0% only" in str(found)
    failed = row("hull", 12, 0.0, 1.0, 100) | {"converged": False, "pressure_error": None}
    assert recommend_mesh(PRESSURE, 0.05, (failed, *ROWS)) == recommend_mesh(PRESSURE, 0.05, ROWS)


def test_every_question_has_an_answer_from_the_table():
    for question, found in zip(QUESTIONS, recommend_meshes(), strict=True):
        assert found.question == question and 0 < found.reference_error < 1 and question in str(found)
        assert found.cpu_s > 0 and (not found.adequate or found.difference + found.reference_error <= found.tolerance)
    assert (
        recommend_mesh(PRESSURE, 0.5).adequate
        and recommend_mesh(WAVE, 0.5).adequate
        and not recommend_mesh(WAVE, 1e-4).adequate
    )
