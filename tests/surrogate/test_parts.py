"""How the benchmark separates edges from plateaus."""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
benchmark = importlib.import_module("surrogate_error")
N = benchmark.ACROSS


def halves():
    """One half 1.5 times as stiff as the other, from the column right of the centre."""
    truth = np.full((N, N), 2e3)
    truth[:, N // 2 + 1 :] = 3e3
    return truth


def test_points_beside_a_jump():
    near = benchmark.beside_jumps(halves())
    reach = benchmark.NEAR * (N - 1)
    columns = np.abs(np.arange(N) - (N // 2 + 0.5)) <= reach + 1e-9
    assert columns.sum() == 4 and np.array_equal(near, np.tile(columns, (N, 1)))
    smooth = np.full((N, N), 2e3) * (1 + 0.5 * np.sin(np.linspace(0, 3, N)))
    assert not benchmark.beside_jumps(smooth).any()
    assert np.array_equal(benchmark.beside_jumps(halves().T), near.T)


@pytest.mark.parametrize("part", benchmark.PARTS)
def test_what_is_off_in_one_part_is_not_off_in_the_other(part):
    truth = halves()
    near = benchmark.beside_jumps(truth)
    found = np.where(near if part == "edge" else ~near, 1.1 * truth, truth)
    data = SimpleNamespace(truth_views={"storage": truth.ravel()}, poisson=0.3, frequency=[50.0])
    told = {"modality": "waves", "family": "halves"}
    row = benchmark.row(told, data, "off", lambda _: {"storage": found.ravel()})
    other = next(each for each in benchmark.PARTS if each != part)
    assert row["parts"][part] == pytest.approx(0.1) and row["parts"][other] == pytest.approx(0, abs=1e-12)
    assert 0 < row["error"] < 0.1
