"""Slabs with only the through-slice motion measured: slice-by-slice inversion, and the share of out-of-slice propagation."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import grid, wave_number, waves

from ngbrain.cli import main
from ngbrain.errors import InputError
from ngbrain.inverse.data.direct_inversion import uniform_modulus
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.elastography.invert_slices import invert_slices, moving_axis, share_through, slices_of
from ngbrain.inverse.problem.discretisation import discretise
from ngbrain.inverse.uncertainty.credible_maps import uncertainty
from ngbrain.io.waves import write_waves

G, SPACING = 2000 + 800j, 3e-3
SHAPE = (20, 18, 4)


def slab(tilt=0.0, axis=2, noise=0.01):
    """Two waves with motion along an axis, which leave the slices across it by an angle; a disc of tissue."""
    shape = list(SHAPE[:2])
    shape.insert(axis, SHAPE[2])
    points, k = grid(*shape, spacing=SPACING), wave_number(G)
    other = [i for i in range(3) if i != axis]
    x, y, z = points[:, other[0]], points[:, other[1]], points[:, axis]
    u = np.zeros((1, len(points), 3), complex)
    for a, size in (((1.0, 0.0), 1e-5), ((0.6, 0.8), 8e-6)):
        u[0, :, axis] += size * np.exp(-1j * k * (np.cos(tilt) * (a[0] * x + a[1] * y) + np.sin(tilt) * z))
    middle = points.mean(axis=0)
    mask = np.linalg.norm((points - middle)[:, other], axis=1) < 0.5 * np.ptp(points[:, other[0]])
    return waves(points, u, poisson=None, bulk=2.2e9, mask=mask).with_noise(noise, seed=1)


@pytest.fixture(scope="module")
def found():
    return invert(slab(), max_iterations=4)


def three_components():
    """A slab of 5 slices, two shear waves whose displacement has three components, which leave the slices; 2 % noise."""
    points, k, u = grid(12, 11, 5, spacing=SPACING), wave_number(G), 0
    for along in ([0.94, 0.0, 0.34], [0.56, 0.75, -0.35]):
        across = np.cross(along, [0.3, -0.5, 0.81])
        u = u + np.exp(-1j * k * (points @ along))[:, None] * across
    return waves(points, 1e-5 * u[None], poisson=None, bulk=2e6).with_noise(0.02, seed=1)


def test_a_slab_of_three_components_has_a_start():
    """Splines need eight points along each axis: a slab is smoothed by moving least squares."""
    found = uniform_modulus(three_components())
    assert found.value == pytest.approx(G, rel=0.25) and not found.note


@pytest.mark.slow
def test_a_slab_of_three_components_is_inverted_in_space():
    data = three_components()
    u, wrong = data.displacement.copy(), np.flatnonzero(~data.border)[::20]
    u[0, wrong, 1] += 2 * data.rms.max()
    found = invert(replace(data, displacement=u))
    assert np.isnan(found.data.displacement[0, wrong, 1]).all()
    assert found.usable and np.nanmedian(found.maps["storage"]) == pytest.approx(G.real, rel=0.03)
    assert np.nanmedian(found.maps["loss"]) == pytest.approx(G.imag, rel=0.05)


def test_slices_one_by_one(found):
    data = slab()
    assert np.nanmedian(found.maps["storage"]) == pytest.approx(G.real, rel=0.02)
    assert np.nanmedian(found.maps["loss"]) == pytest.approx(G.imag, rel=0.04)
    assert found.model["slices"] == 4 and found.model["form"] == "P3"  # motion through a plane has no pressure
    assert np.isnan(found.maps["storage"][~data.mask]).all()
    assert np.isfinite(found.maps["storage"][data.mask]).mean() > 0.9
    off = (found.predicted - data.displacement)[0, :, 2]
    assert np.nanstd(off) / data.rms[0, 0, 2] < 0.02 and np.isnan(found.predicted[:, :, :2]).all()
    assert found.usable and found.noise_found == pytest.approx(0.01, rel=0.2)
    assert found.to_dict()["checks"]["share_through_slices"] < 0.01
    assert "4 slices are inverted one by one" in found.warnings[0]
    assert sum("apparent moduli" in note for note in found.warnings) == 1


def test_gross_errors_of_a_few_slices_are_left_out():
    data = slab()
    u, wrong = data.displacement.copy(), np.flatnonzero(data.mask & ~data.border)[::40]
    u[0, wrong, 2] += 2 * data.rms[0, 0, 2]
    found = invert(replace(data, displacement=u), max_iterations=1)
    assert np.isnan(found.data.displacement[0, wrong, 2]).mean() > 0.9
    assert any("gross errors" in note for note in found.warnings)
    gaining = replace(data, displacement=np.conj(data.displacement))
    with pytest.raises(InputError, match="waves that gain energy"):
        invert(gaining)


def test_the_share_of_waves_that_leave_the_slices():
    for tilt in (0.2, 0.5):
        data = slab(tilt, noise=0.05)
        apparent = {
            name: np.full(len(data.points), part / np.cos(tilt) ** 2)
            for name, part in (("storage", G.real), ("loss", G.imag))
        }
        assert share_through(data, 2, apparent) == pytest.approx(np.sin(tilt) ** 2, rel=0.2)
    two = slab()
    two = replace(two, mask=two.mask & (two.points[:, 2] < 1.5 * SPACING), dirichlet=None)
    assert share_through(two, 2, apparent) is None


def test_which_data_are_such():
    data = slab(axis=0)
    assert moving_axis(slab()) == 2 and moving_axis(data) == 0
    u = data.displacement.copy()
    u[0, 7, 1] = 1e-6
    assert moving_axis(replace(data, displacement=u, mask=np.ones(len(u[0]), bool))) is None
    u = np.where(data.displacement == 0, np.nan, data.displacement)
    assert moving_axis(replace(data, displacement=u)) == 0
    assert moving_axis(replace(data, frequency=[0.0])) is None


def test_slices_keep_what_belongs_to_their_points():
    data = slab(axis=1)
    labels = np.arange(len(data.points))
    own, one = slices_of(replace(data, labels=labels), 1)[2]
    assert one.points == pytest.approx(data.points[own][:, [0, 2]]) and np.ptp(data.points[own, 1]) == 0
    assert one.displacement[:, :, 0] == pytest.approx(data.displacement[:, own, 1])
    assert one.labels.tolist() == own.tolist() and one.grid.shape == SHAPE[:2]
    few = replace(data, mask=data.mask & (data.points[:, 0] < 2.5 * SPACING), dirichlet=None)
    with pytest.raises(InputError, match="mask is of a few points of each slice"):
        slices_of(few, 1)


def test_no_error_bars_of_slices(found, tmp_path, capsys):
    with pytest.raises(InputError, match="wanted: one of a single body"):
        uncertainty(found)
    write_waves(tmp_path / "slab.npz", slab())
    assert main(["invert", str(tmp_path / "slab.npz"), "--bars", "-o", str(tmp_path / "out"), "-q"]) == 2
    assert "one slice in a file of its own" in capsys.readouterr().err


def test_elements_over_a_mask_are_as_large_as_the_waves_allow():
    (_, one), *_ = slices_of(slab(), 2)
    elements = discretise(one)
    assert not elements.nodal and elements.mesh.ne < one.mask.sum() / 6
    assert elements.inside[one.mask].mean() > 0.95
    ring = np.linalg.norm(one.points - one.points.mean(axis=0), axis=1) > 12e-3
    hollow = discretise(replace(one, mask=one.mask & ring, dirichlet=None))
    assert set(hollow.mesh.GetBoundaries()) == {"hull"} and hollow.mesh.ne < elements.mesh.ne


def test_slices_that_say_the_same():
    data, found = slab(), invert(slices_of(slab(), 2)[0][1], uniform=False, regulariser="smooth", max_iterations=2)
    notes = iter([["a of 3 %", "b"], ["a of 4 %", "b"], ["a of 5 %", "b"], ["b", "c"]])
    several = invert_slices(data, 2, lambda _, callback: replace(found, warnings=next(notes)))
    assert several.warnings[1:] == ["a of 3 % (a slice; 3 of 4 alike)", "b", "c (a slice; 1 of 4 alike)"]


@pytest.mark.one_thread
@pytest.mark.slow
def test_slices_side_by_side_are_the_same_to_the_last_bit(found):
    together = invert(slab(), max_iterations=4, executor=2)
    for name, values in found.maps.items():
        np.testing.assert_array_equal(together.maps[name], values)
    np.testing.assert_array_equal(together.predicted, found.predicted)
