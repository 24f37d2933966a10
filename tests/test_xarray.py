"""Images, waves, maps and series as arrays of xarray: values at the right places, with units."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

import ngbrain as nb
from ngbrain.errors import MissingExtra
from ngbrain.image.labelling import Segmentation
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Scan, Volume
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.io.waves import WaveData
from ngbrain.scene.result import SceneResult
from ngbrain.surgery.protocol_run import ProtocolResult

NUMBERS = np.arange(24).reshape(2, 3, 4)
PLACE = np.array([[0, -2e-3, 0, 0.01], [1e-3, 0, 0, 0.02], [0, 0, 3e-3, -0.03], [0, 0, 0, 1.0]])
"""The first axis of the voxels is y, the second is x backwards."""


@pytest.fixture(autouse=True)
def xarray():
    return pytest.importorskip("xarray")


def test_voxels_are_where_the_affine_puts_them():
    image = Volume(NUMBERS, PLACE)
    made = image.to_xarray("T1", "1", "signal")
    assert made.dims == ("y", "x", "z") and made.attrs["units"] == "1" and made.x.attrs["units"] == "m"
    for index in ((0, 0, 0), (1, 2, 3), (0, 1, 2)):
        x, y, z = image.to_world(np.array([index]))[0]
        assert made.sel(x=x, y=y, z=z, method="nearest", tolerance=1e-9) == NUMBERS[index]
    assert np.reshape(made.attrs["affine"], (4, 4)).tolist() == PLACE.tolist()


def test_oblique_voxels_keep_their_indices():
    turned = PLACE.copy()
    turned[2, 0] = 1e-4
    made = Volume(NUMBERS, turned).to_xarray()
    assert made.dims == ("i", "j", "k") and made.sel(i=1, j=2, k=3) == NUMBERS[1, 2, 3]


def test_labels_say_what_their_numbers_mean():
    data = np.zeros((2, 2, 2), np.uint8)
    data[0] = 7
    data[1, 1] = 3
    labels = LabelMap(Volume(data, PLACE), {3: "white", 7: "grey"})
    made = labels.to_xarray()
    names = dict(zip(made.attrs["flag_values"], made.attrs["flag_meanings"].split(), strict=True))
    assert [names[int(number)] for number in (made[0, 0, 0], made[1, 1, 0], made[1, 0, 0])] == [
        "grey",
        "white",
        "outside",
    ]
    tissues = Segmentation(Volume(np.full((2, 2, 2), 3, np.uint8), PLACE), 5.0).to_xarray()
    assert tissues.attrs["flag_meanings"] == "outside white" and int(tissues.max()) == 1
    scan = Scan(Volume(NUMBERS, PLACE), PLACE, NUMBERS.shape, "head.nii")
    assert scan.to_xarray().attrs["source"] == "head.nii" and scan.to_xarray().name == "T1"


def test_waves_on_a_grid_are_along_its_axes():
    points = np.array([[x, y] for y in (0.0, 0.01, 0.02) for x in (0.1, 0.12, 0.14, 0.16)])
    u = 1e-6 * (points[None] + 1j * np.arange(1, 3)[:, None, None])
    data = WaveData(points, u, [50.0, 60.0], 1000.0, "isotropic", "elastic", 0.49, truth={"youngs": 1e3 + points[:, 0]})
    made = data.to_xarray()
    assert made.displacement.dims == ("x", "y", "load", "component") and made.displacement.attrs["units"] == "m"
    assert made.frequency.values.tolist() == [50.0, 60.0] and made.frequency.attrs["units"] == "Hz"
    at = made.displacement.sel(x=0.14, y=0.02, method="nearest").sel(component="y", load=1)
    assert complex(at) == pytest.approx(1e-6 * (0.02 + 2j))
    assert made.true_youngs.sel(x=0.12, method="nearest").values == pytest.approx([1000.12] * 3)
    assert made.true_youngs.attrs == {"units": "Pa", "long_name": "true Young's modulus"}


def test_scattered_points_are_along_one_axis(rng):
    points = 0.1 * rng.random((12, 2))
    data = WaveData(points, 1e-6 * np.ones((1, 12, 2)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    made = data.to_xarray()
    assert made.displacement.dims == ("load", "point", "component") and np.array_equal(made.x, points[:, 0])


def test_maps_of_an_inversion_have_units():
    data = Phantom.from_name("CV-G", 13).simulate_measurements(0.02).data()
    found = nb.invert(data, noise=0.02, regulariser="smooth")
    made = found.to_xarray()
    assert set(made.storage.dims) == {"x", "y"} and made.storage.attrs["units"] == "Pa"
    flat = data.grid.flat(made.storage.transpose("x", "y").values)
    assert np.array_equal(flat, found.maps["storage"], equal_nan=True)
    assert all(variable.attrs["units"] and variable.attrs["long_name"] for variable in made.data_vars.values())
    assert made.predicted.shape[:2] == data.grid.shape and made.attrs["usable"] == str(found.usable)


def test_series_are_along_time():
    rows = {"t": np.array([0.0, 1.0]), "pressure": np.array([0.0, 500.0]), "min_det_F": np.array([1.0, 0.9])}
    run = SimpleNamespace(rows=rows, status="converged", events=(0.5,))
    made = ProtocolResult.to_xarray(run)
    assert float(made.pressure.sel(time=1.0)) == 500 and made.pressure.attrs["units"] == "Pa"
    assert made.time.attrs["units"] == "s" and made.min_det_F.attrs["units"] == "1"
    found = {name: {"series": {"t_s": [0.0, 2.0], "pressure_mmHg": [0.0, 9.0]}} for name in ("held", "staged")}
    result = SceneResult({"answers": found})
    made = result.to_xarray("staged")
    assert float(made.pressure_mmHg.sel(time=2.0)) == 9 and made.pressure_mmHg.attrs["units"] == "mmHg"
    with pytest.raises(nb.errors.InputError, match="protocol is not given; wanted"):
        result.to_xarray()
    answer = {"quantity": "force on top", "value": 2.0, "unit": "N", "error_estimate": None, "tolerance": 0.1}
    made = SceneResult({"answers": [answer]}).to_xarray()
    assert float(made.value.sel(quantity="force on top")) == 2 and made.unit.values.tolist() == ["N"]
    assert np.isnan(made.error_estimate.values).all()


def test_without_xarray_the_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(MissingExtra, match=r"xarray.*ngbrain\[xarray\]"):
        Volume(NUMBERS, PLACE).to_xarray()
