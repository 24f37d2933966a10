"""Wave data of other sources: MATLAB files of both kinds, displacements on voxels, other units, all missing keys at once."""

import json

import h5py
import numpy as np
import pytest
import scipy.io

from ngbrain.cli import main
from ngbrain.errors import InputError
from ngbrain.io.waves import read_waves
from ngbrain.io.waves.nifti import TEMPLATE

SHAPE, SPACING = (5, 4, 3), (2e-3, 3e-3, 4e-3)
MATERIAL = {"density": 1000.0, "symmetry": "isotropic", "rheology": "viscoelastic", "bulk": 2.2e9}


def volume(rng):
    return 1e-6 * (rng.normal(size=(*SHAPE, 3)) + 1j * rng.normal(size=(*SHAPE, 3)))


def same(data, u):
    """Whether data have the values of (x, y, z, 3) at the right places."""
    for i, j, k in ((0, 0, 0), (4, 1, 2), (2, 3, 1)):
        (n,) = np.flatnonzero(np.abs(data.points - np.multiply((i, j, k), SPACING)).max(axis=1) < 1e-9)
        np.testing.assert_allclose(data.displacement[0, n], u[i, j, k], rtol=1e-12)
    return data.loads == 1 and len(data.points) == 60 and data.grid is not None


def matlab_7_3(path, keys):
    """As MATLAB writes it: axes in reverse order, complex numbers as pairs, text as numbers."""
    with h5py.File(path, "w") as file:
        for name, value in keys.items():
            if isinstance(value, str):
                file[name] = np.array([[ord(letter)] for letter in value], np.uint16)
                file[name].attrs["MATLAB_class"] = np.bytes_("char")
                continue
            value = np.atleast_2d(value).T
            if np.iscomplexobj(value):
                pairs = np.empty(value.shape, [("real", float), ("imag", float)])
                pairs["real"], pairs["imag"] = value.real, value.imag
                value = pairs
            file[name] = value


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_matlab_files_on_voxels_in_other_units(version, tmp_path, rng):
    u, mask = volume(rng), rng.random(SHAPE) < 0.9
    keys = MATERIAL | {
        "displacement": 1e6 * u,
        "displacement_unit": "um",
        "spacing": 1e3 * np.array(SPACING),
        "length_unit": "mm",
        "frequency": 50.0,
        "mask": mask,
    }
    write = scipy.io.savemat if version == "5" else matlab_7_3
    write(tmp_path / "waves.mat", keys)
    data = read_waves(tmp_path / "waves.mat")
    assert same(data, u) and data.frequency.tolist() == [50.0] and data.rheology == "viscoelastic"
    np.testing.assert_array_equal(data.grid.box(data.mask), mask)


def test_archives_may_have_voxels_too(tmp_path, rng):
    u = volume(rng)
    np.savez(tmp_path / "waves.npz", displacement=u, spacing=SPACING, frequency=[50.0], **MATERIAL)
    assert same(read_waves(tmp_path / "waves.npz"), u)
    np.savez(
        tmp_path / "two.npz", displacement=u, spacing=SPACING, points=np.zeros((60, 3)), frequency=[50.0], **MATERIAL
    )
    with pytest.raises(InputError, match="points or spacing, not both"):
        read_waves(tmp_path / "two.npz")
    np.savez(
        tmp_path / "unit.npz", displacement=u, displacement_unit="inch", spacing=SPACING, frequency=[50.0], **MATERIAL
    )
    with pytest.raises(InputError, match="displacement_unit is 'inch'"):
        read_waves(tmp_path / "unit.npz")


def test_a_volume_of_three_components_is_one_load(tmp_path, rng):
    nibabel = pytest.importorskip("nibabel")
    u, affine = volume(rng), np.diag([*(1e3 * np.array(SPACING)), 1.0])
    nibabel.save(nibabel.Nifti1Image(1e6 * u, affine), tmp_path / "waves.nii.gz")
    (tmp_path / "waves.json").write_text(json.dumps(MATERIAL | {"frequency": [50.0], "displacement_unit": "um"}))
    assert same(read_waves(tmp_path / "waves.nii.gz"), u)


def test_all_that_is_missing_is_said_at_once_of_the_file_it_belongs_to(tmp_path, rng):
    np.savez(tmp_path / "waves.npz", displacement=volume(rng), spacing=SPACING)
    with pytest.raises(InputError, match="frequency, density, symmetry, rheology, poisson or bulk is missing"):
        read_waves(tmp_path / "waves.npz")
    np.savez(tmp_path / "bare.npz", displacement=volume(rng))
    with pytest.raises(InputError, match="points or spacing, frequency, density"):
        read_waves(tmp_path / "bare.npz")
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Image(volume(rng), np.diag([2.0, 2.0, 2.0, 1.0])), tmp_path / "waves.nii.gz")
    (tmp_path / "waves.json").write_text('{"density": 1000}')
    with pytest.raises(InputError, match=r"waves\.json: frequency, symmetry, rheology, poisson or bulk is missing"):
        read_waves(tmp_path / "waves.nii.gz")
    (tmp_path / "waves.json").unlink()
    with pytest.raises(InputError, match=r"waves\.json: sidecar is missing.*--template"):
        read_waves(tmp_path / "waves.nii.gz")


def test_the_template_is_a_sidecar(tmp_path, rng, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["invert", "--template"])
    assert stopped.value.code == 0 and capsys.readouterr().out == TEMPLATE
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Image(volume(rng), np.diag([2.0, 3.0, 4.0, 1.0])), tmp_path / "waves.nii.gz")
    nibabel.save(
        nibabel.Nifti1Image(np.ones(SHAPE, np.uint8), np.diag([2.0, 3.0, 4.0, 1.0])), tmp_path / "NAME_mask.nii.gz"
    )
    (tmp_path / "waves.json").write_text(TEMPLATE)
    assert read_waves(tmp_path / "waves.nii.gz").mask.all()
