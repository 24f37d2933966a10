"""DICOM series: the same image as in NIfTI, one of several series, missing slices."""

import locale

import nibabel
import numpy as np
import pytest
import SimpleITK
from resampled_scans import rotation

from ngbrain.errors import InputError
from ngbrain.image.read.image_file import open_volume, read_scan

SHAPE, SPACING = (60, 56, 44), (2.0, 2.0, 2.5)


@pytest.fixture(autouse=True)
def same_locale():
    """Restore the locale: ITK's DICOM writer sets "C", in which later tests would read text as ASCII."""
    before = locale.setlocale(locale.LC_ALL)
    yield
    locale.setlocale(locale.LC_ALL, before)


@pytest.fixture(scope="module")
def picture():
    """A sagittal, oblique series' values (slice, row, column), directions (columns) and origin (mm), as DICOM has them."""
    rng = np.random.default_rng(0)
    values = rng.integers(0, 900, SHAPE[::-1]).astype(np.int16)
    directions = rotation(12.0, np.array([1.0, 2.0, 0.5])) @ np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])
    return values, directions, np.array([52.0, -70.0, 60.0])


def write(folder, picture, uid, kept=None, name="slice"):
    values, directions, origin = picture
    folder.mkdir(exist_ok=True)
    writer = SimpleITK.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for k in kept if kept is not None else range(len(values)):
        image = SimpleITK.GetImageFromArray(values[k])
        image.SetSpacing(SPACING[:2])
        place = origin + k * SPACING[2] * directions[:, 2]
        tags = {
            "0008|0060": "MR",
            "0008|103e": f"T1 {name}",
            "0020|000e": uid,
            "0020|000d": "1.2.3",
            "0008|0018": f"{uid}.{k + 1}",
            "0020|0013": str(k),
            "0020|0032": "\\".join(f"{x:.6f}" for x in place),
            "0020|0037": "\\".join(f"{x:.8f}" for x in directions[:, :2].T.ravel()),
        }
        for key, value in tags.items():
            image.SetMetaData(key, value)
        writer.SetFileName(str(folder / f"{name}{(7 * k) % 97:03d}.dcm"))  # names are in no order
        writer.Execute(image)
    return folder


def test_a_series_is_the_picture_of_its_nifti(picture, tmp_path):
    values, directions, origin = picture
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = directions * SPACING, origin
    image = nibabel.Nifti1Image(values.transpose(2, 1, 0).astype(np.float32), np.diag([-1, -1, 1, 1]) @ affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "t1.nii.gz")
    wanted, found = read_scan(tmp_path / "t1.nii.gz"), read_scan(write(tmp_path / "series", picture, "1.2.3.4"))
    assert found.file_shape == wanted.file_shape == SHAPE
    assert found.file_affine == pytest.approx(wanted.file_affine, abs=1e-8)
    assert np.abs(found.volume.data - wanted.volume.data).max() < 0.1
    assert np.array_equal(np.asarray(open_volume(tmp_path / "series").image.dataobj), values.transpose(2, 1, 0))


def test_of_several_series_one_is_chosen_by_a_file_of_it(picture, tmp_path):
    folder = write(tmp_path / "both", picture, "1.2.3.5")
    other = (picture[0][::-1].copy(), *picture[1:])
    write(folder, other, "1.2.3.6", name="other")
    with pytest.raises(
        InputError, match=r"folder with 2 DICOM series \(44 files 'T1 \w+', as \w+.dcm; .*\); wanted: one"
    ):
        open_volume(folder)
    found = open_volume(folder / "other014.dcm")
    assert np.array_equal(np.asarray(found.image.dataobj), other[0].transpose(2, 1, 0))


def test_what_is_no_series_of_a_head(picture, tmp_path):
    with pytest.raises(InputError, match=r"missing: image is a DICOM series with slices 2.5 to 5 mm from each other"):
        open_volume(write(tmp_path / "missing", picture, "1.2.3.7", [*range(20), *range(21, 44)]))
    twice = write(tmp_path / "twice", picture, "1.2.3.8", range(10))
    (twice / "again.dcm").write_bytes((twice / "slice014.dcm").read_bytes())
    with pytest.raises(InputError, match=r"several slices at one place"):
        open_volume(twice)
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match=r"none: image is a folder without a DICOM series"):
        open_volume(tmp_path / "none")
    cut = write(tmp_path / "cut", picture, "1.2.3.9", range(3))
    for file in cut.iterdir():
        file.write_bytes(file.read_bytes()[:900])
    with pytest.raises(InputError, match=r"cut: image is"):
        open_volume(cut)
