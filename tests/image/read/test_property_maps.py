"""Maps of a measured quantity: in files and at points."""

import zipfile

import numpy as np
import pytest

pytest.importorskip("nibabel", reason='nibabel is not installed; get it with: pip install "ngbrain[mri]"')

from ngbrain.errors import InputError  # noqa: E402
from ngbrain.image.read.nifti import write_nifti  # noqa: E402
from ngbrain.image.read.property_maps import fill_missing, interpolate_map, measured_mask, read_map  # noqa: E402
from ngbrain.image.read.volume import Volume  # noqa: E402

PLACE = np.array([[-2e-3, 0, 0, 8e-3], [0, 2e-3, 0, 0], [0, 0, 2e-3, 0], [0, 0, 0, 1]])
"""The first axis runs to the left, as in the templates of FSL."""


def linear(shape=(5, 6, 7)) -> Volume:
    x, y, z = np.einsum("ij,jklm->iklm", PLACE[:3, :3], np.indices(shape)) + PLACE[:3, 3, None, None, None]
    return Volume(1000 + 1e5 * (x + 2 * y + 3 * z), PLACE)


def test_a_linear_map_is_itself_at_any_point_of_a_zip_file(tmp_path, rng):
    write_nifti(tmp_path / "map.nii", linear())
    with zipfile.ZipFile(tmp_path / "map.nii.zip", "w") as archive:
        archive.write(tmp_path / "map.nii", "map.nii")
        archive.writestr("__MACOSX/._map.nii", b"rubbish")
    points = rng.uniform(0, 8e-3, (50, 3))
    for file in ("map.nii", "map.nii.zip"):
        found = interpolate_map(read_map(tmp_path / file, "kPa"), points)
        np.testing.assert_allclose(found, 1000 + 1e5 * points @ [1, 2, 3], rtol=1e-9)


@pytest.mark.parametrize("hole", [0.0, np.nan])
def test_what_was_not_measured_is_told_and_filled(tmp_path, hole):
    volume = linear()
    volume.data[2, 3, 3:] = hole
    write_nifti(tmp_path / "map.nii.gz", volume)
    found = read_map(tmp_path / "map.nii.gz", "Pa")
    assert np.isnan(found.data).sum() == 4
    middles = found.to_world(np.argwhere(np.ones(found.data.shape, bool)))
    assert (~measured_mask(found, middles)).sum() == 4
    assert fill_missing(found).data[2, 3, 4] in (
        volume.data[1, 3, 4],
        volume.data[3, 3, 4],
        volume.data[2, 2, 4],
        volume.data[2, 4, 4],
    )


def test_a_map_in_another_space_is_refused(rng):
    volume = linear()
    points = rng.uniform(0, 8e-3, (100, 3))
    assert measured_mask(volume, points).all()
    for other in (points + 30e-3, 1e-3 * points + 20e-3, 1e3 * points):
        with pytest.raises(
            InputError, match=r"map is without a value at .* of the body; wanted: one in the space of the body"
        ):
            measured_mask(volume, other)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda v: -v, "as low as -"),
        (lambda v: 0 * v, "without a value above 0"),
        (lambda v: np.stack([v, v], axis=-1), "of 4 axes"),
    ],
)
def test_what_is_no_map_is_refused_and_named(tmp_path, change, line):
    write_nifti(tmp_path / "map.nii.gz", Volume(change(linear().data), PLACE))
    with pytest.raises(InputError, match=rf"map\.nii\.gz: map is {line}"):
        read_map(tmp_path / "map.nii.gz", "Pa")


def test_archives_of_other_than_one_file_and_damaged_ones_are_refused(tmp_path):
    write_nifti(tmp_path / "map.nii", linear())
    path = tmp_path / "two.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(tmp_path / "map.nii", "one.nii")
        archive.write(tmp_path / "map.nii", "other.nii")
    with pytest.raises(InputError, match=r"two\.zip: image is a ZIP archive of 2 files; wanted: one file"):
        read_map(path, "Pa")
    raw = bytearray(path.read_bytes())
    path.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(InputError, match=r"two\.zip: image is unreadable \(BadZipFile"):
        read_map(path, "Pa")
