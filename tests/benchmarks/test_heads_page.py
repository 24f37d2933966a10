"""The page of results on heads says what the records say."""

from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def pages(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import _heads_page

    return _heads_page


def test_a_head_without_a_report_counts_and_says_why(pages):
    run = {"run": {"commit": "abc", "date": "2026-01-01"}, "cpu_s": 12.3, "peak_gib": 1.5}
    lost = {"head": "lost_t1.nii", "demo": run | {"exit": 2, "report": False, "reason": "no brain"}}
    there = {"peak_pressure_mmHg": {"one": 150.4, "two": 160.6}, "peak_force_N": {"one": 4.0, "two": 5.0}}
    sizes = {"brain_ml": 1500.0, "ventricles_ml": 20.0, "brain_off": -0.002, "ventricles_off": 0.001}
    place = {"smallest_dihedral_deg": 12.0, "place_off_mm": 3.0, "depth_mm": 26.5}
    made = {"head": "made_t1.nii", "about": "a head", "demo": run | {"exit": 0, "report": True} | there | sizes | place}
    text = pages.demos([lost, made, {"head": "other"}])
    assert text.startswith("1 of 2 reached the report (commit abc, 2026-01-01)")
    assert "| lost | **no** | 12 | 1.5 | no brain |" in text
    assert (
        "| made: a head | yes | 12 | 1.5 | 1500 | 20.0 | 0.20% | 12.0° | 3.0, 26.5 | 150 to 161 | 4.00 to 5.00 |"
        in text
    )
    assert len({line.count("|") for line in text.splitlines()[2:]}) == 1
