"""Scans: same bits for flipped copies, the same head for oblique and coarser ones, units, all refusals."""

import gzip
import subprocess
import sys

import nibabel
import numpy as np
import pytest
from resampled_scans import fine, rotation, slanted, thick
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image import Volume, border_value, mni152, read_scan, resample_to_ras
from ngbrain.image.read.template import template_map

MM = np.diag([1e3, 1e3, 1e3, 1])
BOX = (slice(22, 175), slice(23, 212), slice(0, 159))  # the brain and 4 mm around it; none below the brain stem


@pytest.fixture(scope="module")
def brain():
    """MNI152 with a smaller margin."""
    whole = mni152().volume
    affine = whole.affine.copy()
    affine[:3, 3] = whole.to_world(np.array([[s.start for s in BOX]]))[0]
    return Volume(np.ascontiguousarray(whole.data[BOX]), affine)


@pytest.fixture(scope="module")
def wedge():
    """Grey values that rise from corner to corner over 102 mm a side: cheap to write and to read."""
    grid = np.indices((34, 34, 34)).sum(axis=0).astype(np.float32)
    return grid, np.diag([3.0, 3.0, 3.0, 1.0])


def write(path, data, affine, unit="mm", kind=nibabel.Nifti1Image):
    image = kind(data, affine)
    image.header.set_xyzt_units(unit)
    image.set_sform(affine, 2)
    image.set_qform(None, 0)
    nibabel.save(image, path)
    return path


def test_to_world_and_back(rng):
    affine = np.eye(4)
    affine[:3, :3] = rotation(30, np.array([1.0, 1, 1])) @ np.diag([1e-3, 2e-3, 3e-3])
    volume = Volume(np.zeros((3, 4, 5)), affine)
    points = rng.normal(size=(7, 3))
    assert np.allclose(volume.to_world(volume.to_voxels(points)), points, rtol=0, atol=1e-12)
    assert np.allclose(volume.spacing, [1e-3, 2e-3, 3e-3])
    assert volume.voxel_volume == pytest.approx(6e-9)


def test_at_is_exact_for_linear_pictures_up_to_the_last_voxel(rng):
    affine = np.diag([1e-3, 2e-3, 0.5e-3, 1])
    affine[:3, 3] = [0.1, -0.2, 0.3]
    indices = np.indices((6, 7, 8))
    volume = Volume(1 + 2 * indices[0] - 3 * indices[1] + indices[2], affine)
    inside = np.vstack([rng.uniform(0, 1, (20, 3)) * [5, 6, 7], [[0, 0, 0], [5, 6, 7]]])
    assert np.allclose(volume.interpolate(volume.to_world(inside)), 1 + inside @ [2, -3, 1], atol=1e-9)
    assert volume.interpolate(volume.to_world(np.array([[-2, 3, 3]])), outside=-7.0) == [-7.0]
    # No jump at the last voxel, so that rounding errors do not matter.
    assert volume.interpolate(volume.to_world(np.array([[-0.1, 0, 0]])), outside=-9.0) == pytest.approx(
        [0.9 * 1 - 0.1 * 9]
    )


def test_the_digest_knows_values_types_shapes_and_places(brain):
    small = Volume(brain.data[:20, :20, 80:100], brain.affine)
    affine = small.affine.copy()
    affine[0, 3] += 1e-9
    changed = small.data.copy()
    changed[3, 4, 5] += 1e-3
    others = [
        Volume(small.data.astype(float), small.affine),
        Volume(small.data.reshape(20, 40, 10), small.affine),
        Volume(small.data, affine),
        Volume(changed, small.affine),
    ]
    assert len({v.digest() for v in [small, *others]}) == 5
    assert Volume(np.asfortranarray(small.data), small.affine.copy()).digest() == small.digest()


def test_maps_of_the_template_are_those_of_nilearn_without_what_its_loaders_import():
    from nilearn.datasets import load_mni152_gm_template, load_mni152_template, load_mni152_wm_template

    for name, load in (("t1", load_mni152_template), ("gm", load_mni152_gm_template), ("wm", load_mni152_wm_template)):
        theirs, (data, affine) = load(resolution=1), template_map(name)
        assert data.dtype == np.float32 and np.array_equal(data, np.array(theirs.dataobj, np.float32))
        assert np.array_equal(affine, np.diag([1e-3, 1e-3, 1e-3, 1]) @ theirs.affine)
    code = "import sys; from ngbrain.image import mni152; mni152(); sys.exit('sklearn' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_mni152_is_on_the_grid_and_ours_to_change():
    scan = mni152()
    assert np.allclose(scan.volume.affine, scan.file_affine, rtol=0, atol=1e-12)
    assert border_value(scan.volume) == (0.0, pytest.approx(0.99983, abs=1e-5))
    assert len(np.unique(scan.volume.data)) == 225
    scan.volume.data[:] = 5
    assert mni152().volume.data.max() == 1


@pytest.mark.parametrize("turn", [((1, -1), (0, 1), (2, 1)), ((2, -1), (1, -1), (0, -1)), ((0, -1), (2, 1), (1, 1))])
def test_flipped_and_permuted_copies_give_the_same_bits(brain, turn, tmp_path):
    # A place with digits that float32 headers round.
    affine = brain.affine + np.array([[0, 0, 0, 0.371e-3], [0, 0, 0, 0.013e-3], [0, 0, 0, -0.249e-3], [0] * 4])
    small = Volume(brain.data[20:130, 20:140, 20:130], affine)
    plain = read_scan(write(tmp_path / "plain.nii", small.data, MM @ affine))
    assert np.array_equal(plain.volume.data, small.data)
    assert np.allclose(plain.volume.affine, affine, rtol=0, atol=1e-8)

    orientation = np.array(turn)
    data = nibabel.orientations.apply_orientation(small.data, orientation)
    turned = affine @ nibabel.orientations.inv_ornt_aff(orientation, small.data.shape)
    copy = read_scan(write(tmp_path / "turned.nii.gz", data, MM @ turned))
    assert copy.volume.digest() == plain.volume.digest()
    assert copy.file_shape == data.shape
    # Voxels of the file are the same voxels.
    stored = np.argwhere(data == data.max())[:5]
    values = copy.volume.interpolate(Volume(data, copy.file_affine).to_world(stored))
    assert np.allclose(values, data.max(), atol=1e-4)


@pytest.mark.parametrize(("unit", "scale"), [("meter", 1e-3), ("micron", 1e3), ("unknown", 1.0)])
def test_units_of_the_file(wedge, unit, scale, tmp_path):
    data, affine = wedge
    affine = np.diag([scale] * 3 + [1]) @ affine
    kind = nibabel.Nifti2Image if unit == "micron" else nibabel.Nifti1Image
    scan = read_scan(write(tmp_path / "scan.nii", data, affine, unit, kind))
    assert np.allclose(scan.file_affine, np.diag([3e-3, 3e-3, 3e-3, 1]), rtol=1e-6)
    assert scan.volume.data.shape == (102, 102, 102)
    assert scan.source == str(tmp_path / "scan.nii")


def test_scaling_and_a_last_axis_of_one(wedge, tmp_path):
    data, affine = wedge
    image = nibabel.Nifti1Image(data.astype(np.int16)[..., None], affine)
    image.header.set_slope_inter(0.5, -3)
    nibabel.save(image, tmp_path / "scan.nii")
    scan = read_scan(tmp_path / "scan.nii")
    assert scan.file_shape == (34, 34, 34) and scan.volume.data.dtype == np.float32
    assert scan.volume.interpolate(np.array([[30e-3, 30e-3, 30e-3]])) == pytest.approx(0.5 * 30 - 3, abs=1e-4)


def test_the_sform_wins(wedge, tmp_path):
    data, affine = wedge
    image = nibabel.Nifti1Image(data, affine)
    image.set_qform(np.diag([2.0, 2.0, 2.0, 1.0]), 1)
    image.set_sform(affine, 2)
    nibabel.save(image, tmp_path / "scan.nii")
    assert np.allclose(read_scan(tmp_path / "scan.nii").file_affine, affine * [1e-3, 1e-3, 1e-3, 1])


@pytest.fixture(scope="module", params=[slanted, thick, fine])
def copy(brain, request, tmp_path_factory):
    other = request.param(brain)
    path = write(tmp_path_factory.mktemp("copy") / "scan.nii", other.data, MM @ other.affine)
    return other, read_scan(path)


def test_a_copy_on_another_grid_is_the_same_head(brain, copy):
    other, scan = copy
    # Where the original lies in the new grid: whole voxels away.
    start = scan.volume.to_voxels(brain.to_world(np.zeros((1, 3))))[0]
    assert np.allclose(start, start.round(), atol=1e-4)
    low = np.maximum(start.round().astype(int), 0)
    skip = low - start.round().astype(int)
    new = scan.volume.data[tuple(slice(a, a + n) for a, n in zip(low, brain.data.shape - skip, strict=True))]
    old = brain.data[tuple(slice(a, a + n) for a, n in zip(skip, new.shape, strict=True))]
    a, b = old != 0, new != 0
    # Slices of 2 mm have lost what the sharp rim of the brain was like; beneath it there is no excuse.
    core = ndimage.binary_erosion(a, iterations=3)
    whole, within = (np.corrcoef(old[part], new[part])[0, 1] for part in (a, core))
    dice, size = 2 * (a & b).sum() / (a.sum() + b.sum()), np.count_nonzero(scan.volume.data) / a.sum()
    print(f"Dice {dice:.4f}, volume {size:.4f}, correlation {whole:.4f}, in the core {within:.4f}")
    assert dice > 0.98 and abs(size - 1) < 0.01 and within > 0.995
    assert whole > (0.96 if other.spacing[2] > 1.5e-3 else 0.99)
    assert new.min() == 0 and new.max() <= old.max()


def test_voxels_of_the_file_keep_their_place(copy):
    other, scan = copy
    assert np.allclose(scan.file_affine, other.affine, rtol=0, atol=1e-8)
    bright = np.argwhere(ndimage.minimum_filter(other.data[::4, ::4, ::4], 3) > 0.7)[::50] * 4
    difference = (
        scan.volume.interpolate(Volume(other.data, scan.file_affine).to_world(bright)) - other.data[tuple(bright.T)]
    )
    assert len(bright) > 5 and np.sqrt(np.mean(difference**2)) < 0.05


def test_a_picture_straightened_twice_is_the_same(wedge):
    data, affine = wedge
    once = resample_to_ras(Volume(data, np.linalg.inv(MM) @ affine))
    assert resample_to_ras(once).digest() == once.digest()


def test_rounding_errors_of_an_affine_do_not_show():
    data, affine = np.zeros((2, 2, 2), np.float32), np.diag([1e-3, 1e-3, 1e-3, 1])
    noisy = affine - 1e-13 * np.eye(4, k=1)
    assert resample_to_ras(Volume(data, noisy)).digest() == resample_to_ras(Volume(data, affine)).digest()


def test_ringing_is_cut_off():
    # A cube of ones: cubic splines overshoot inside and leave ripples around it.
    data = np.pad(np.ones((20, 20, 20), np.float32), 10)
    new = resample_to_ras(Volume(data, np.diag([2e-3, 2e-3, 2e-3, 1])))
    assert new.data.min() == 0 and new.data.max() == 1
    # The cube reaches from 19 to 59 mm; at its edges the share of the picture falls below a half.
    assert new.data.shape == (81, 81, 81)  # up to the far sides of the first and last voxels, -1 and 79 mm
    filled = new.to_world(np.argwhere(new.data))
    assert np.allclose(filled.min(axis=0), 19e-3) and np.allclose(filled.max(axis=0), 59e-3)


def test_fine_detail_is_smoothed_not_aliased():
    # Stripes of one 0.5 mm voxel; on 1 mm points they would be all 0 or all 1.
    data = np.zeros((200, 30, 30), np.float32)
    data[::2] = 1
    new = resample_to_ras(Volume(data, np.diag([0.5e-3, 1e-3, 1e-3, 1]))).data[10:-10]
    assert np.all((new == 0) | (abs(new - 0.5) < 0.12))


def test_too_large_a_grid_is_refused():
    thin = Volume(np.zeros((2, 2, 2), np.float32), np.diag([0.5, 0.5, 0.5, 1]))
    with pytest.raises(InputError, match=r"image is 1001x1001x1001 voxels of 1 mm; wanted: at most 512³ of them"):
        resample_to_ras(thin)


def _changed(data, at, value):
    data = data.astype(np.float32)
    data[at] = value
    return data


BAD = {
    "4-D": (lambda d, a: nibabel.Nifti1Image(np.stack([d, d], -1), a), r"image shape is \(34, 34, 34, 2\)"),
    "2-D": (lambda d, a: nibabel.Nifti1Image(d[0], a), r"image shape is \(34, 34\)"),
    "complex": (lambda d, a: nibabel.Nifti1Image(d.astype(np.complex64), a), "image is made of complex64 numbers"),
    "rgb": (
        lambda d, a: nibabel.Nifti1Image(np.zeros(d.shape, [("R", "u1"), ("G", "u1"), ("B", "u1")]), a),
        "image is made of colours",
    ),
    "nan": (lambda d, a: nibabel.Nifti1Image(_changed(d, (3, 4, slice(8, 10)), np.nan), a), "number in 2 voxels"),
    "inf": (lambda d, a: nibabel.Nifti1Image(_changed(d, (3, 4, 5), np.inf), a), "a finite number in 1 voxels"),
    "too large for float32": (lambda d, a: nibabel.Nifti1Image(1e40 * d.astype(float), a), "number in 39303 voxels"),
    "constant": (lambda d, a: nibabel.Nifti1Image(d * 0 + 7, a), "image is 7 everywhere"),
    "few labels": (lambda d, a: nibabel.Nifti1Image(d // 20, a), r"a map of labels \(5 values"),
    "small": (lambda d, a: nibabel.Nifti1Image(d[:, :30], a), "102 x 90 x 102 mm; wanted: a whole head"),
    "coarse": (lambda d, a: nibabel.Nifti1Image(d, 2 * a), "image voxel is 6 x 6 x 6 mm; wanted: 0.2 to 5 mm"),
    "minute": (lambda d, a: nibabel.Nifti1Image(d, a / 30), "image voxel is 0.1 x 0.1 x 0.1 mm"),
    "metres said, mm meant": (lambda d, a: _unit(nibabel.Nifti1Image(d, a), 1), "image voxel is 3000 x 3000 x 3000"),
    "no codes": (lambda d, a: _codes(nibabel.Nifti1Image(d, a), 0, a), "image affine is not given"),
    "flat": (lambda d, a: _codes(nibabel.Nifti1Image(d, a), 2, a * [1, 1, 0, 1]), "three independent axes"),
    "nan affine": (lambda d, a: _codes(nibabel.Nifti1Image(d, a), 2, a * np.nan), "three independent axes, finite"),
}


def _unit(image, code):
    image.header["xyzt_units"] = code
    return image


def _codes(image, sform, affine):
    image.header["qform_code"], image.header["sform_code"] = 0, sform
    for row, name in enumerate(("srow_x", "srow_y", "srow_z")):
        image.header[name] = affine[row]
    return image


@pytest.mark.parametrize("name", BAD)
def test_pictures_that_are_no_scan_are_refused(wedge, name, tmp_path):
    make, message = BAD[name]
    image = make(*wedge)
    path = tmp_path / "scan.nii"
    image.to_filename(path) if name not in ("no codes", "flat", "nan affine") else path.write_bytes(raw(image))
    refused(path, message)


def raw(image):
    """The file as the header says, where nibabel would put the affine right."""
    image.header["magic"], image.header["vox_offset"] = b"n+1", 352
    return image.header.binaryblock + bytes(4) + np.asarray(image.dataobj, np.float32).tobytes(order="F")


def refused(path, message):
    with pytest.raises(InputError, match=message) as caught:
        read_scan(path)
    assert str(caught.value).startswith(f"{path}: image ") and "\n" not in str(caught.value)


def test_files_that_are_no_scan_are_refused(wedge, rng, tmp_path):
    good = write(tmp_path / "good.nii.gz", *wedge).read_bytes()
    plain = gzip.decompress(good)
    damaged = bytearray(good)
    damaged[len(good) // 2] ^= 0xFF
    broken = bytearray(plain)
    broken[40:42] = (99).to_bytes(2, "little")  # the number of axes
    analyze = nibabel.AnalyzeImage(wedge[0], np.eye(4))
    analyze.to_filename(tmp_path / "analyze.img")
    mgh = nibabel.MGHImage(*wedge).to_bytes()
    (tmp_path / "folder.nii").mkdir()
    files = {
        "missing.nii": (None, "image is missing"),
        "folder.nii": (None, "image is a folder"),
        "analyze.img": (None, "neither a NIfTI nor an MGH file"),
        "analyze.hdr": (None, "neither a NIfTI nor an MGH file"),
        "short.mgh": (mgh[:-500], "cut short"),
        "empty.nii": (b"", "an empty file"),
        "empty.nii.gz": (gzip.compress(b""), "an empty file"),
        "random.nii": (rng.bytes(1000), "neither a NIfTI nor an MGH file"),
        "random.nii.gz": (b"\x1f\x8b" + rng.bytes(1000), "unreadable"),
        "case.toml": (b"[case]\nname = 'a'\n", "neither a NIfTI nor an MGH file"),
        "short.nii": (plain[:-500], "cut short"),
        "header.nii": (plain[:352], "cut short"),
        "half_a_header.nii": (plain[:348], "cut short"),
        "broken.nii": (bytes(broken), "damaged"),
        "short.nii.gz": (good[:-500], "unreadable"),
        "damaged.nii.gz": (bytes(damaged), "unreadable"),
    }
    for name, (content, message) in files.items():
        if content is not None:
            (tmp_path / name).write_bytes(content)
        refused(tmp_path / name, message)


def test_mgh_is_read_as_nifti_is(wedge, tmp_path):
    data, affine = wedge
    nibabel.MGHImage(np.float32(data), affine).to_filename(tmp_path / "scan.mgz")
    ours, other = read_scan(tmp_path / "scan.mgz"), read_scan(write(tmp_path / "scan.nii", np.float32(data), affine))
    assert np.array_equal(ours.volume.data, other.volume.data)
    assert ours.file_affine == pytest.approx(other.file_affine, abs=1e-8) and ours.file_shape == other.file_shape


def test_nan_around_a_head_is_background(wedge, tmp_path):
    """NaN outside the head, as some software writes it, is accepted; inside the head it is refused."""
    data, affine = wedge
    around = np.zeros(data.shape, bool)
    around[:, :, -2:] = True
    lowest = np.where(around, data[~around].min(), data).astype(np.float32)
    for name, values in (("nan", np.where(around, np.nan, data)), ("low", lowest)):
        nibabel.Nifti1Image(values.astype(np.float32), affine).to_filename(tmp_path / f"{name}.nii")
    one, other = (read_scan(tmp_path / f"{name}.nii").volume for name in ("nan", "low"))
    np.testing.assert_array_equal(one.data, other.data)


def test_places_that_are_mirror_images_are_refused(wedge, tmp_path):
    data, affine = wedge
    image = nibabel.Nifti1Image(data, affine)
    image.set_sform(affine, 1)
    image.set_qform(affine @ np.diag([-1, 1, 1, 1]), 1)
    image.to_filename(tmp_path / "scan.nii")
    refused(tmp_path / "scan.nii", "disagree about left and right")


def test_too_large_a_picture_is_refused_with_its_file(tmp_path):
    data = np.zeros((130, 130, 130), np.float32)
    data[0, 0, :20] = np.arange(20)
    path = write(tmp_path / "scan.nii", data, np.diag([5.0, 5.0, 5.0, 1]))
    refused(path, "image is 650x650x650 voxels of 1 mm; wanted: at most 512³ of them")
