"""A map of |G*| from an inversion: place, magnitude and error; and waves that make none."""

from types import SimpleNamespace

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.io.waves import WaveData
from ngbrain.surgery.twin import waves
from ngbrain.surgery.twin.waves import map_from_inversion

SHAPE, STEP, ORIGIN = (4, 3, 5), 3e-3, np.array([0.01, -0.02, 0.03])


def data(dim=3, frequency=(50.0,)):
    sides = [ORIGIN[i] + STEP * np.arange(SHAPE[i]) for i in range(dim)]
    points = np.column_stack([np.meshgrid(*sides, indexing="ij")[i].ravel(order="F") for i in range(dim)])
    u = np.full((len(frequency), len(points), dim), 1e-6 + 0j)
    return WaveData(points, u, frequency, 1000.0, "isotropic", "viscoelastic", poisson=0.49)


def inversion(of, storage=3000.0, loss=4000.0):
    n = len(of.points)
    return SimpleNamespace(data=of, maps={"storage": np.full(n, storage), "loss": np.full(n, loss)})


def test_the_map_is_the_magnitude_where_the_waves_are(monkeypatch):
    def draws():
        spread = np.exp(0.1 * np.random.default_rng(0).normal(size=(4000, 1))) * np.ones((1, np.prod(SHAPE)))
        return {"storage": 3000.0 * spread, "loss": 4000.0 * spread}

    monkeypatch.setattr(waves, "uncertainty", lambda found: SimpleNamespace(draws=draws))
    found = map_from_inversion(inversion(data()))
    assert found.modulus.data.shape == SHAPE and found.modulus.data == pytest.approx(5000.0)
    assert found.deviation.data == pytest.approx(0.1, rel=0.05) and found.frequency == 50
    last = found.modulus.to_world(np.array([[3, 2, 4]]))
    assert last == pytest.approx(ORIGIN[None] + STEP * np.array([[3, 2, 4]]))


def test_an_inversion_without_a_posterior_has_an_assumed_error(monkeypatch):
    def none(found):
        raise InputError("inversion", "of zones", "one with a posterior")

    monkeypatch.setattr(waves, "uncertainty", none)
    found = map_from_inversion(inversion(data()))
    assert found.deviation.data == pytest.approx(0.2) and "20% assumed" in found.note


@pytest.mark.parametrize(
    ("of", "line"),
    [(data(dim=2), "in a plane"), (data(frequency=(50.0, 60.0)), "at 50, 60 Hz; wanted: waves of one frequency")],
)
def test_other_waves_are_refused(of, line, monkeypatch):
    monkeypatch.setattr(waves, "uncertainty", lambda found: SimpleNamespace(draws=lambda: found.maps | {}))
    with pytest.raises(InputError, match=line):
        map_from_inversion(inversion(of))
