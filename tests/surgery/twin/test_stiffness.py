"""Relative stiffness from a map: conversion, intervals, place, lesions, and maps of another place or unit."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.image.read.volume import Volume
from ngbrain.surgery.twin.case import Lesion, StiffnessData
from ngbrain.surgery.twin.norms import NormalTissue
from ngbrain.surgery.twin.stiffness import MeasuredMap, RelativeStiffness, choose_places

AFFINE = np.diag([2e-3, 2e-3, 2e-3, 1.0])
SHAPE = (21, 21, 21)
NORMAL = {
    "soft": NormalTissue(region="soft", modulus=1000.0),
    "stiff": NormalTissue(region="stiff", modulus=4000.0),
    "fluid": None,
}
CENTRE = np.array([0.02, 0.02, 0.02])


def mapped(values, sd=0.1, **more):
    found = MeasuredMap(Volume(values, AFFINE), Volume(np.full(SHAPE, sd), AFFINE), 50.0, "a map")
    return RelativeStiffness(NORMAL, CENTRE[None], 10e-3, found, **more)


def test_the_ratio_is_that_to_the_norm_of_the_tissue():
    found = mapped(np.full(SHAPE, 3000.0))
    log = found.log_map(CENTRE[None])[0]
    assert found.reference == pytest.approx(2000.0)
    assert np.exp(log - found.log_norm("soft")) == pytest.approx(3.0)
    assert np.exp(log - found.log_norm("stiff")) == pytest.approx(0.75)


def test_a_shift_moves_the_map():
    x = np.broadcast_to(np.arange(21)[:, None, None], SHAPE)
    found = mapped(1000.0 * np.exp(0.1 * x))
    moved = found.log_map(CENTRE[None], np.array([2e-3, 0, 0])) - found.log_map(CENTRE[None])
    assert moved == pytest.approx(0.1)


def test_an_unresolved_lesion_takes_the_stiffness_around_it_and_a_resolved_one_the_maps():
    values = np.full(SHAPE, 1000.0)
    off = np.linalg.norm(np.indices(SHAPE).T * 2e-3 - CENTRE, axis=-1)
    values[off < 4e-3] = 5000.0
    small, large = (Lesion(centre=tuple(CENTRE), diameter=d) for d in (6e-3, 8e-3))
    at = CENTRE[None]
    assert np.exp(mapped(values, lesions=(small,)).log_map(at)) * 2000 == pytest.approx(1000.0)
    assert np.exp(mapped(values, lesions=(large,)).log_map(at)) * 2000 == pytest.approx(5000.0)
    assert mapped(values, lesions=(large,)).lesion_priors == ()


def test_errors_are_those_of_the_map_and_the_models():
    found = mapped(np.full(SHAPE, 3000.0), sd=0.3, extra_deviation=0.4)
    assert found.deviations() == pytest.approx([0.5])
    weights = RelativeStiffness(NORMAL, np.array([[0, 0, 0], [0.02, 0, 0]]), 10e-3).weights(np.array([[0.005, 0, 0]]))
    assert (weights**2).sum() == pytest.approx(1.0) and weights[0, 0] > weights[0, 1] > 0


def test_a_map_far_away_is_refused_with_the_distance():
    found = mapped(np.full(SHAPE, 3000.0))
    assert found.check_on(CENTRE + 1e-3 * np.eye(3))["ratio_median"] == pytest.approx(1.5)
    with pytest.raises(
        InputError, match=r"stiffness.map is without a value at 100% of the body; its middle is 200 mm away"
    ):
        found.check_on(CENTRE + np.array([[0.2, 0, 0]]))


def test_a_map_in_another_unit_is_refused():
    with pytest.raises(
        InputError, match=r"stiffness.map is 0.0015 times the norm of 2000 Pa in the median; wanted: \|G\*\| in Pa"
    ):
        mapped(np.full(SHAPE, 3.0)).check_on(CENTRE[None])


def test_intervals_become_standard_deviations(tmp_path):
    pytest.importorskip("nibabel")
    from ngbrain.image.read.nifti import write_nifti

    for name, value in (("map", 2000.0), ("low", 1000.0), ("high", 4000.0), ("sd", 500.0)):
        write_nifti(tmp_path / f"{name}.nii", Volume(np.full(SHAPE, value, np.float32), AFFINE))
    paths = {name: str(tmp_path / f"{name}.nii") for name in ("map", "low", "high", "sd")}
    by_ends = MeasuredMap.read(StiffnessData(frequency=50.0, map=paths["map"], low=paths["low"], high=paths["high"]))
    # ln 4 is 2 x 1.96 standard deviations
    assert by_ends.deviation.data == pytest.approx(np.log(4) / 3.91993, rel=1e-4)
    assert MeasuredMap.read(
        StiffnessData(frequency=50.0, map=paths["map"], sd=paths["sd"])
    ).deviation.data == pytest.approx(0.25)
    with pytest.raises(InputError, match=r"stiffness.low is above the map"):
        MeasuredMap.read(StiffnessData(frequency=50.0, map=paths["low"], low=paths["map"], high=paths["high"]))


def test_places_begin_with_the_sites_and_cover_the_body():
    points = np.random.default_rng(0).uniform(0, 0.1, (500, 3))
    places = choose_places(points, points[:2], 0.03)
    gaps = np.linalg.norm(points[:, None] - places[None], axis=2).min(axis=1)
    assert np.array_equal(places[:2], points[:2]) and gaps.max() <= 0.03
    assert len(choose_places(points, points[:2], 0.001)) == 60
