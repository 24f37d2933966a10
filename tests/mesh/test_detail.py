"""Which mesh a question needs: the table that comes with the library, and what is read off it."""

import json
from pathlib import Path

import pytest

from ngbrain.mesh import detail
from ngbrain.mesh.detail import QUESTIONS, need, needs

BENCHMARK = Path(__file__).parents[2] / "benchmarks/mesh_routes.json"
PRESSURE, WAVE = "mean pressure under a dent of 5 mm", "displacement in tissue by a wave of 50 Hz"


def row(route, size, error, cpu_s, **more):
    return {
        "method": f"ngbrain:{route}",
        "size_mm": size,
        "order": 2,
        "error": error,
        "cpu_s": cpu_s,
        "converged": True,
        **more,
    }


ROWS = (
    row("hull", 10, 0.04, 8.0),
    row("lattice", 9, 0.02, 9.0),
    row("hull", 7, 0.01, 20.0),
    row("conforming", 8, 0.0, 40.0),
)


def test_the_table_is_the_benchmark_s():
    shipped = Path(detail.__file__).with_name(detail.TABLE)
    assert json.loads(shipped.read_text()) == json.loads(BENCHMARK.read_text())


@pytest.mark.parametrize(
    ("within", "route", "size"),
    [
        (0.1, "hull", 10),
        (0.05, "hull", 10),
        (0.04, "lattice", 9),
        (0.03, "lattice", 9),
        (0.025, "hull", 7),
        (0.015, "conforming", 8),
    ],
)
def test_the_cheapest_that_is_sure_to_do(within, route, size):
    found = need(PRESSURE, within, ROWS)
    assert (found.route, 1e3 * found.size, found.known) == (route, pytest.approx(size), 0.01)


def test_nothing_is_claimed_beyond_what_the_finest_is_known_to():
    found = need(PRESSURE, 0.009, ROWS)
    assert found.route is None and "no mesh that was measured is sure to do; the finest is known to 1.0%" in str(found)
    failed = row("hull", 12, 0.0, 1.0) | {"converged": False, "error": None}
    assert need(PRESSURE, 0.05, (failed, *ROWS)) == need(PRESSURE, 0.05, ROWS)
    assert need(WAVE, 0.5, ROWS).route is None


def test_every_question_has_an_answer_from_the_table():
    for question, found in zip(QUESTIONS, needs(), strict=True):
        assert found.question == question and 0 < found.known < 1 and question in str(found)
        if found.route:
            assert found.difference + found.known <= found.within and found.cpu_s > 0
    assert sum(found.route is not None for found in needs()) >= 2
