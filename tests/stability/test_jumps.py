"""Error bars where moduli jump. Naive: the posterior at the map's own jumps. Ours: a jump may be anywhere within the resolution.

Two discs in a slice with motion through it, 2 % noise, data from triangles along their edges, the prior `edges`.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from uncertainty_seeds import discs

from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.uncertainty.credible_maps import uncertainty
from ngbrain.inverse.uncertainty.interval import CredibleInterval


@pytest.fixture(scope="module")
def bars():
    exact, elements = discs(1)
    found = invert(exact.with_noise(0.02, 1), elements, uniform=False, regulariser="edges", callback=lambda _: None)
    return uncertainty(found, prior="own")


def coverage(bars, interval):
    """Share of the points at which the 95 % intervals of both moduli hold the truth."""
    inside, held = bars.problem.inside, []
    for name in ("storage", "loss"):
        band, truth = interval(name), np.real(bars.data.truth_views[name])
        held.append(((band.low <= truth) & (truth <= band.high))[inside])
    return np.mean(held)


def test_naive_jumps_count_as_known(bars):
    def known(name):
        rows, transform = bars._rows[name], bars._quantities[name].transform
        return CredibleInterval.from_gaussian(
            rows @ bars.posterior.x, np.sqrt(bars.posterior.variance(rows)), transform, 0.95
        )

    assert coverage(bars, known) < 0.9


def test_within_the_resolution(bars):
    assert coverage(bars, bars.interval) > 0.93
    drawn = bars.arrays()
    assert np.all(drawn["magnitude_low"] < drawn["magnitude_high"])
    width = [np.median((drawn[f"{name}_high"] - drawn[f"{name}_low"]) / bars.found.maps["storage"])
             for name in ("storage", "magnitude")]  # fmt: skip
    assert width[1] == pytest.approx(width[0], rel=0.25)
