"""Label maps from files: numbers and names, schemes of other programs, other grids, files that are no label map."""

import nibabel
import numpy as np
import pytest
from phantoms import nested, turned
from resampled_scans import rotation

from ngbrain.errors import InputError
from ngbrain.image.read.label_file import read_labels, read_labels_with_notes
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.landmarks import landmarks
from ngbrain.image.read.nifti import resample_labels, write_nifti
from ngbrain.image.read.volume import Volume

MILLIMETRES = np.diag([1e3, 1e3, 1e3, 1])


@pytest.fixture(scope="module")
def labels():
    return nested((12.0, 9.0, 4.0))


def written(path, data, affine, **header):
    image = nibabel.Nifti1Image(data, MILLIMETRES @ affine)
    image.header.set_xyzt_units("mm")
    image.set_sform(image.affine, header.get("code", 1))
    image.set_qform(None, 0)
    nibabel.save(image, path)
    return path


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.float32])
@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".mgz"])
def test_numbers_of_any_type_in_any_file(labels, kind, suffix, tmp_path):
    path = tmp_path / f"labels{suffix}"
    if suffix == ".mgz":
        nibabel.MGHImage(
            labels.volume.data.astype(kind), (MILLIMETRES @ labels.volume.affine).astype(np.float32)
        ).to_filename(path)
    else:
        written(path, labels.volume.data.astype(kind), labels.volume.affine)
    found = read_labels(path, {1: "grey", 2: "white", 3: "ventricles"})
    assert np.array_equal(found.volume.data, labels.volume.data) and found.regions == labels.regions
    assert found.volume.affine == pytest.approx(labels.volume.affine, abs=1e-9)


def test_numbers_of_freesurfer_are_known_and_others_are_not_guessed(labels, tmp_path):
    aseg = np.array([0, 2, 41, 4])[labels.volume.data]
    aseg[:, :, :3], aseg[:, :, 3], aseg[0, 0, 5] = 16, 1035, 251
    found = read_labels(written(tmp_path / "aseg.nii", aseg.astype(np.int16), labels.volume.affine))
    assert found.regions == ("white", "ventricles", "brain_stem", "corpus_callosum", "grey")
    wmparc = np.array([0, 3035, 5002, 43])[labels.volume.data]
    wmparc[:, :, :3], wmparc[:, :, 3] = 5001, 2035
    found, notes = read_labels_with_notes(
        written(tmp_path / "wmparc.nii", wmparc.astype(np.int16), labels.volume.affine)
    )
    assert found.regions == ("ventricles", "grey", "white") and notes[0].endswith("FreeSurfer's wmparc")
    plain = written(tmp_path / "labels.nii", labels.volume.data.astype(np.uint8), labels.volume.affine)
    question = (
        r"labels.nii: labels is numbered 1, 2, 3 without names; wanted: --names spm \(1 grey, 2 white, 3 csf\), cat or fast or "
        r"ngbrain \(1 csf, 2 grey, 3 white\), freesurfer, synthseg, muse, or N=NAME"
    )
    with pytest.raises(InputError, match=question):
        read_labels(plain)
    some = written(tmp_path / "some.nii", np.array([0, 2, 3, 4], np.uint8)[labels.volume.data], labels.volume.affine)
    with pytest.raises(InputError, match=r"some.nii: labels is numbered 2, 3, 4 without names"):
        read_labels(some)  # FreeSurfer's numbers, but of one side
    own = written(tmp_path / "own.nii", np.array([0, 1, 7, 9], np.uint8)[labels.volume.data], labels.volume.affine)
    found, notes = read_labels_with_notes(own)
    assert found.regions == ("label_1", "label_7", "label_9") and "no ventricles are known" in notes[0]
    assert read_labels(plain, "spm").regions == ("grey", "white", "csf")
    with pytest.raises(
        InputError, match=r"names is 'spn'; wanted: number = name for every label, or one of freesurfer, synthseg, muse"
    ):
        read_labels(plain, "spn")
    with pytest.raises(InputError, match=r"labels.nii: labels is without a name for \[3\]"):
        read_labels(tmp_path / "labels.nii", {1: "grey", 2: "white"})


def test_regions_of_ones_own_in_a_map_of_freesurfer(labels, tmp_path):
    aseg = np.array([0, 2, 41, 4])[labels.volume.data]
    aseg[:4] = 999
    path = written(tmp_path / "aseg.nii", aseg.astype(np.int16), labels.volume.affine)
    with pytest.raises(
        InputError,
        match=r"aseg.nii: labels is numbered as by FreeSurfer.* but for 999; wanted: names freesurfer,999=NAME,…",
    ):
        read_labels(path)
    found = read_labels(path, "freesurfer", {999: "tumour"})
    assert found.regions == ("white", "ventricles", "tumour")
    assert read_labels(path, None, {999: "tumour"}).regions == found.regions
    assert found.volumes_ml()["tumour"] == pytest.approx(1e6 * (aseg == 999).sum() * labels.volume.voxel_volume)


def test_numbers_of_muse_are_known(tmp_path):
    row = np.array([0, 1, 4, 35, 38, 39, 51, 52, 59, 81, 95, 102], np.uint8)
    found, notes = read_labels_with_notes(
        written(tmp_path / "muse.nii", row.reshape(2, 2, 3), np.diag([1e-3] * 3 + [1.0]))
    )
    assert found.regions == (
        "csf", "ventricles", "brain_stem", "cerebellum", "deep_grey", "white", "corpus_callosum", "grey"
    )  # fmt: skip
    assert notes == ("numbers are taken for those of MUSE and Neuromorphometrics",)


def test_scaled_integers_are_rounded_and_it_is_said(labels, tmp_path):
    names = {1: "grey", 2: "white", 3: "ventricles"}
    data = labels.volume.data * (1 + 7e-10)
    found, notes = read_labels_with_notes(written(tmp_path / "scaled.nii", data, labels.volume.affine), names)
    assert np.array_equal(found.volume.data, labels.volume.data)
    assert notes == ("numbers up to 2e-09 off whole numbers are rounded",)
    with pytest.raises(InputError, match=r"labels is not whole numbers, up to 0\.003 off"):
        read_labels(written(tmp_path / "off.nii", labels.volume.data * 1.001, labels.volume.affine), names)


def test_partial_volumes_take_the_nearest_tissue(tmp_path):
    data = np.array([0.2, 0.8, 1.4, 1.6, 2.4, 3.0, 0.5, 3.9], np.float32).reshape(2, 2, 2)
    path = written(tmp_path / "p0sub.nii", data, np.diag([1e-3] * 3 + [1.0]))
    found, notes = read_labels_with_notes(path, "cat")
    assert found.volume.data.ravel().tolist() == [0, 1, 1, 2, 2, 3, 0, 4] and found.regions == ("csf", "grey", "white")
    assert notes == ("partial volumes take the nearest tissue",)


@pytest.mark.parametrize(
    ("names", "order", "program"),
    [(("c1s.nii", "c2s.nii", "c3s.nii"), ("grey", "white", "csf"), "spm"),
     (("p1s.nii", "p2s.nii", "p3s.nii"), ("grey", "white", "csf"), "cat"),
     (("s_pve_0.nii", "s_pve_1.nii", "s_pve_2.nii"), ("csf", "grey", "white"), "fast")],
)  # fmt: skip
def test_of_three_shares_side_by_side_the_largest_counts(names, order, program, tmp_path):
    shares = np.array([[0.1, 0.6, 0.2, 0.1], [0.1, 0.2, 0.7, 0.1], [0.1, 0.1, 0.1, 0.8]], np.float32)
    for name, share in zip(names, shares, strict=True):
        written(tmp_path / name, share.reshape(2, 2, 1), np.diag([1e-3] * 3 + [1.0]))
    for scheme in (None, program):
        found, notes = read_labels_with_notes(tmp_path / names[1], scheme)
        assert found.volume.data.ravel().tolist() == [0, 1, 2, 3] and found.regions == order
        assert notes == (f"the largest share of {', '.join(names)} counts",)
    (tmp_path / names[2]).unlink()
    with pytest.raises(InputError, match=rf"labels is without {names[2]}; wanted: the shares of all three"):
        read_labels(tmp_path / names[0])


def test_a_name_of_what_is_outside_is_no_region(labels, tmp_path):
    path = written(tmp_path / "labels.nii", labels.volume.data.astype(np.uint8), labels.volume.affine)
    found = read_labels(path, {0: "air", 1: "grey", 2: "white", 3: "ventricles"})
    assert found.regions == labels.regions and np.array_equal(found.region_numbers(), labels.region_numbers())


def test_parcels_are_told_from_grey_values(tmp_path):
    box = np.indices((40, 40, 40)) // 8
    parcels = 1 + (25 * box[0] + 5 * box[1] + box[2])
    path = written(tmp_path / "parcels.nii", parcels.astype(np.int16), np.diag([1e-3] * 3 + [1.0]))
    found = read_labels(path, {number: f"parcel_{number}" for number in range(1, 126)})
    assert len(found.regions) == 125 and found.region_numbers().max() == 125
    grey = np.random.default_rng(0).integers(0, 200, (40, 40, 40))
    with pytest.raises(
        InputError, match="labels is 199 numbers that change from voxel to voxel; wanted: regions: is it a"
    ):
        read_labels(written(tmp_path / "t1.nii", grey.astype(np.uint8), np.diag([1e-3] * 3 + [1.0])))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (np.zeros((9, 9, 9), np.uint8), "labels is 0 everywhere"),
        (
            np.full((9, 9, 9), 1.375, np.float32),
            "not whole numbers, up to 0.38 off; wanted: an integer .* or --names spm",
        ),
        (np.full((9, 9, 9), -1, np.int16), "labels is from -1 to -1"),
        (np.arange(729, dtype=np.int16).reshape(9, 9, 9), "labels is 728 numbers that change from voxel to voxel"),
        (np.full((9, 9, 9), np.nan, np.float32), "labels is not a finite number in 729 voxels; wanted: .* 0 outside"),
    ],
)
def test_what_is_no_map_of_labels(data, words, tmp_path):
    with pytest.raises(InputError, match=words) as error:
        read_labels(written(tmp_path / "a.nii", data, np.diag([1e-3, 1e-3, 1e-3, 1.0])))
    assert "\n" not in str(error.value) and str(tmp_path / "a.nii") in str(error.value)


def test_nan_around_the_labels_is_outside(labels, tmp_path):
    data = labels.volume.data.astype(np.float32)
    assert (data == 0).any()
    one = read_labels(written(tmp_path / "a.nii", np.where(data == 0, np.nan, data), labels.volume.affine), "ngbrain")
    other = read_labels(written(tmp_path / "b.nii", data, labels.volume.affine), "ngbrain")
    np.testing.assert_array_equal(one.volume.data, other.volume.data)


def test_a_lost_place_is_refused(labels, tmp_path):
    path = written(tmp_path / "a.nii", labels.volume.data.astype(np.uint8), labels.volume.affine, code=0)
    with pytest.raises(InputError, match="image affine is not given"):
        read_labels(path)


def test_upright_copies_show_the_same(labels):
    flipped = LabelMap(
        Volume(labels.volume.data[::-1].transpose(2, 0, 1), labels.volume.affine @ turn()), labels.names
    ).resample_to_ras()
    assert np.array_equal(flipped.volume.data, labels.volume.data)
    oblique = turned(labels, rotation(20.0, np.array([1.0, 1.0, 0.3]))).resample_to_ras()
    print(oblique.volumes_ml(), labels.volumes_ml())
    assert oblique.volumes_ml() == pytest.approx(labels.volumes_ml(), rel=0.03)
    assert labels.resample_to_ras(2e-3).volumes_ml()["grey"] == pytest.approx(labels.volumes_ml()["grey"], rel=0.1)


def turn():
    """Indices of the flipped and permuted array to those of the original."""
    n = nested((12.0, 9.0, 4.0)).volume.data.shape[0]
    back = np.zeros((4, 4))
    back[0, 1], back[0, 3] = -1, n - 1
    back[1, 2] = back[2, 0] = back[3, 3] = 1
    return back


def test_maps_go_back_to_the_grid_they_came_from(labels, tmp_path):
    oblique = turned(labels, rotation(20.0, np.array([1.0, 1.0, 0.3])))
    upright = oblique.resample_to_ras()
    back = resample_labels(
        Volume(upright.region_numbers(), upright.volume.affine), oblique.volume.affine, oblique.volume.data.shape
    )
    same = (back.data == oblique.volume.data)[oblique.volume.data > 0].mean()
    print("same", same)
    assert same > 0.9
    write_nifti(tmp_path / "maps.nii.gz", back)
    image = nibabel.load(tmp_path / "maps.nii.gz")
    assert np.array_equal(np.asarray(image.dataobj), back.data)
    assert image.affine == pytest.approx(MILLIMETRES @ oblique.volume.affine, abs=1e-4)
    with pytest.raises(InputError, match=r"image file is 'maps.img'"):
        write_nifti(tmp_path / "maps.img", back)


def test_sides_are_told_by_the_place_and_not_by_the_array(labels):
    lopsided = labels.volume.data.copy()
    lopsided[: len(lopsided) // 2][lopsided[: len(lopsided) // 2] == 3] = 2
    one = LabelMap(Volume(lopsided, labels.volume.affine), labels.names)
    mirrored = LabelMap(Volume(lopsided, np.diag([-1, 1, 1, 1]) @ labels.volume.affine), labels.names)
    assert landmarks(one)["right ventricle"][0] > 1e-3 and landmarks(mirrored)["left ventricle"][0] < -1e-3
    assert landmarks(one)["right"] == pytest.approx(landmarks(mirrored)["left"] * [-1, 1, 1], abs=2e-3)
