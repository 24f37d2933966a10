"""Wave data: fields checked one by one, files back to the last bit, damaged files, noise, hulls, the published data sets."""

import json
import shutil
import subprocess
from dataclasses import fields, replace
from pathlib import Path

import h5py
import nibabel
import numpy as np
import pytest
import scipy.io
from resampled_scans import rotation

from ngbrain.errors import InputError, NgbrainError
from ngbrain.io.waves import WaveData, read_waves, write_map, write_waves

MATNLI = "shared/data/matnli"


def grid(*shape, spacing=2e-3):
    return np.indices(shape).reshape(len(shape), -1, order="F").T * spacing


def plane(**changes):
    """A small viscoelastic experiment in the plane with every optional field."""
    rng, points = np.random.default_rng(1), grid(6, 5)
    u = 1e-5 * (rng.normal(size=(2, 30, 2)) + 1j * rng.normal(size=(2, 30, 2)))
    u[1, :, 0] = np.nan
    turn = points[:, 0] / 0.02
    given = {
        "frequency": [50.0, 60.0],
        "density": 1000.0,
        "symmetry": "transversely_isotropic",
        "rheology": "viscoelastic",
        "bulk": 5e5 + 2e4j,
        "fibre": np.stack([np.cos(turn), np.sin(turn)], axis=1),
        "element": "q4",
        "mask": points[:, 0] > 1e-3,
        "noise": 0.01,
        "labels": np.arange(30) % 3,
        "truth": {"mu": 1e3 + points[:, 0], "zeta": points[:, 1], "phi": points[:, 0]},
    }
    return WaveData(points, u, **{**given, **changes})


def space(**changes):
    points = 0.01 + grid(5, 4, 3) @ rotation(20.0, np.array([1.0, 2.0, 0.5])).T
    u = 1e-5 * (np.sin(300 * points) + 1j * np.cos(300 * points))[None]
    shear = 2e3 + 800j + 1e4 * points[:, 0]
    given = {"frequency": [50.0], "density": 1040.0, "symmetry": "isotropic", "rheology": "viscoelastic"}
    return WaveData(points, u, **{**given, "poisson": 0.49, "truth": {"shear": shear}, **changes})


def assert_same(first, second, exact=True):
    for field in fields(WaveData):
        one, other = getattr(first, field.name), getattr(second, field.name)
        if field.name == "truth":
            assert one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)
        elif not exact and field.name in ("points", "affine"):
            assert one is None or np.allclose(one, other, atol=1e-9)
        elif isinstance(one, np.ndarray):
            assert one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind in "fc"), field.name
        else:
            assert one == other, field.name


def by_point():
    """Pointwise noise; missing values outside the mask become 1."""
    return plane(noise=np.where(np.arange(30) % 6 == 0, np.nan, 0.01 + 1e-3 * np.arange(30)))


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".hdf5", ".mat"])
@pytest.mark.parametrize("make", [plane, space, by_point])
def test_archives_come_back_to_the_last_bit(make, suffix, tmp_path):
    write_waves(tmp_path / f"waves{suffix}", make())
    assert_same(make(), read_waves(tmp_path / f"waves{suffix}"))
    assert [each.name for each in tmp_path.iterdir()] == [f"waves{suffix}"]


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
@pytest.mark.parametrize("make", [plane, space, by_point])
def test_images_come_back(make, suffix, tmp_path):
    write_waves(tmp_path / f"waves{suffix}", make())
    found = read_waves(tmp_path / f"waves{suffix}")
    assert_same(make(), found, exact=False)
    write_map(tmp_path / f"stiffness{suffix}", found, np.abs(found.displacement[0, :, 1]))
    image, source = (nibabel.load(tmp_path / f"{name}{suffix}") for name in ("stiffness", "waves"))
    assert np.array_equal(image.affine, source.affine) and image.shape == source.shape[:3]
    assert image.get_fdata()[3, 2, 0] == pytest.approx(np.abs(np.asarray(source.dataobj)[3, 2, 0, 0, 1]))


def test_an_image_in_two_parts_on_an_upright_slice(tmp_path):
    u = 1e-5 * np.random.default_rng(0).normal(size=(2, 6, 5, 1, 1, 2))
    affine = np.array([[0, 0, 3, 40.0], [2, 0, 0, -10], [0, 2, 0, 7], [0, 0, 0, 1]])  # mm; sagittal
    for part, values in zip(("real", "imag"), u, strict=True):
        image = nibabel.Nifti1Image(values, affine)
        image.header.set_xyzt_units("mm")
        nibabel.save(image, tmp_path / f"w_part-{part}.nii.gz")
    sidecar = {"frequency": [50], "density": 1000, "symmetry": "isotropic", "rheology": "viscoelastic", "poisson": 0.4}
    (tmp_path / "w_part-real.json").write_text(json.dumps(sidecar))
    found = read_waves(tmp_path / "w_part-real.nii.gz")
    assert np.allclose(found.points, grid(6, 5))
    assert np.array_equal(found.grid.box(found.displacement[0]), (u[0] + 1j * u[1])[:, :, 0, 0])
    assert found.affine == pytest.approx(np.diag([1e-3, 1e-3, 1e-3, 1]) @ affine)


WRONG = [
    ("points", lambda d: d.points[:, :1], "numbers of shape (n, 2|3)"),
    ("points", lambda d: d.points * np.nan, "not finite"),
    ("points", lambda d: d.points * 1e3, "metres"),
    ("points", lambda d: np.r_[d.points[:-1], d.points[:1]], "twice the same"),
    ("displacement", lambda d: d.displacement[:, 1:], "(n, 30, 2)"),
    ("displacement", lambda d: d.displacement[0], "(n, 30, 2)"),
    ("displacement", lambda d: d.displacement * np.nan, "NaN everywhere in load 0"),
    ("displacement", lambda d: np.full((2, 30, 2), np.inf), "infinite"),
    ("displacement", lambda d: d.displacement * 1e6, "metres"),
    ("displacement", lambda d: d.displacement * 1e-300, "above"),
    ("frequency", lambda d: [50.0], "(2)"),
    ("frequency", lambda d: [50.0, -1.0], "at least 0"),
    ("frequency", lambda d: [50.0, np.nan], "Hz"),
    ("density", lambda d: -1.0, "kg/m³"),
    ("density", lambda d: 1.0, "kg/m³"),
    ("density", lambda d: "heavy", "kg/m³"),
    ("symmetry", lambda d: "isotrop", "did you mean 'isotropic'?"),
    ("rheology", lambda d: "plastic", "elastic"),
    ("element", lambda d: "q5", "q4"),
    ("poisson", lambda d: 0.3, "either"),
    ("bulk", lambda d: None, "either poisson or bulk"),
    ("bulk", lambda d: -1e5, "above 0"),
    ("bulk", lambda d: [1e5, 1e5], "one number"),
    ("fibre", lambda d: None, "unit vectors"),
    ("fibre", lambda d: 2 * d.fibre, "unit vectors"),
    ("fibre", lambda d: d.fibre[:3], "(30, 2)"),
    (
        "displacement",
        lambda d: d.displacement * [[[1.0]], [[0.0]]],
        "displacement is 0 everywhere in load 1; wanted: a body that moves",
    ),
    ("dirichlet", lambda d: d.dirichlet[1:], "bool of shape (29,); wanted: true or false for each of the 30 points"),
    ("mask", lambda d: "brain", "true or false for each of the 30 points"),
    ("dirichlet", lambda d: 2.0 + d.dirichlet, "true or false"),
    ("mask", lambda d: np.zeros(30, bool), "some points"),
    ("noise", lambda d: -0.1, "from 0"),
    ("noise", lambda d: np.full(29, 0.1), "one number, relative (0.02: two per cent), or 30, one for each point"),
    ("noise", lambda d: np.where(np.arange(30) == 7, 0.0, 0.1), "noise is 0 at point 7; wanted: relative, above 0"),
    ("noise", lambda d: np.where(np.arange(30) == 7, np.nan, 0.1), "noise is nan at point 7"),
    ("noise", lambda d: np.where(np.arange(30) == 7, np.inf, 0.1), "at most 10 at every point of the mask"),
    ("labels", lambda d: np.arange(30) - 5, "from 0 on"),
    ("labels", lambda d: np.arange(30) / 2, "whole numbers"),
    ("truth", lambda d: {"young": d.truth["mu"]}, "did you mean 'youngs'?"),
    ("truth", lambda d: {"mu": d.truth["mu"][1:]}, "(30)"),
    ("truth", lambda d: {"mu": -d.truth["mu"]}, "above 0"),
    ("affine", lambda d: np.eye(3), "(4, 4)"),
]


@pytest.mark.parametrize(("name", "wrong", "says"), WRONG)
def test_a_wrong_field_is_named(name, wrong, says):
    data = plane()
    keep = {"dirichlet": None} if name in ("points", "mask") else {}
    if name == "points":  # the element would speak first of a grid that is broken
        keep["element"] = None
    with pytest.raises(InputError) as error:
        replace(data, **{**keep, name: wrong(data)})
    field = "poisson" if name == "bulk" and "either" in says else name
    assert error.value.field.startswith(field) and says in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("poisson", [0.5, -1.0, 0.7, np.nan, 0.3j])
def test_poissons_ratio_is_below_a_half(poisson):
    with pytest.raises(InputError, match=r"poisson is .* below 0\.5"):
        space(poisson=poisson)


def test_elements_need_their_grid(rng):
    data = plane()
    order = np.arange(30).reshape(5, 6).T.ravel()  # along y first
    for points in (
        data.points[order],
        data.points + 2e-4 * rng.normal(size=(30, 2)),
        data.points @ rotation(10, [0, 0, 1])[:2, :2],
    ):
        with pytest.raises(InputError, match="element is q4; wanted: points on a plane grid"):
            replace(data, points=points)
    assert replace(data, points=data.points[order], element=None).grid.axes.tolist() == [[0, 1], [1, 0]]


def test_grids_are_found_and_the_hull_follows_the_mask(rng):
    data = space()
    found = data.grid
    assert found.shape == (5, 4, 3) and found.spacing == pytest.approx(2e-3) and not found.is_axis_aligned
    assert np.allclose(found.points(), data.points) and data.dirichlet.sum() == 60 - 3 * 2 * 1
    assert replace(data, points=data.points.astype(np.float32)).grid.shape == (5, 4, 3)
    assert replace(data, points=data.points + 1e-5 * rng.normal(size=(60, 3))).grid is None
    assert np.array_equal(found.flat(found.box(data.points)), data.points)
    mask = found.flat(np.arange(5)[:, None, None] + np.zeros((5, 4, 3))) > 0
    inner = replace(data, mask=mask, dirichlet=None)
    assert not inner.dirichlet[~mask].any() and inner.dirichlet.sum() == mask.sum() - 2 * 2 * 1


@pytest.mark.parametrize("d", [2, 3])
def test_the_hull_of_scattered_points_follows_a_dent(d, rng):
    side = 60 if d == 2 else 22
    points = grid(*[side] * d, spacing=0.1 / side)
    points = points + 0.2 * 0.1 / side * rng.uniform(-1, 1, points.shape)
    away = np.linalg.norm(points - 0.05, axis=1)
    corner = (points > 0.05).all(axis=1)  # a wedge is missing
    points = points[(away < 0.045) & ~corner]
    u = 1e-6 * np.ones((1, len(points), d))
    data = WaveData(points, u, [0.0], 1000.0, "isotropic", "elastic", poisson=0.3)
    # Distance to the border of the shape: the ball's, or the nearest face of the wedge.
    ball = 0.045 - np.linalg.norm(points - 0.05, axis=1)
    beyond = np.maximum(0.05 - points, 0)
    depth = np.minimum(ball, np.linalg.norm(beyond, axis=1))
    assert data.grid is None
    assert depth[data.dirichlet].max() < 2.5 * 0.1 / side
    assert data.dirichlet[depth < 0.3 * 0.1 / side].mean() > (0.95 if d == 2 else 0.8)


def test_points_on_a_line_are_no_plane():
    points = np.linspace(0, 0.1, 9)[:, None] ** 2 * [[1.0, 2.0]]
    with pytest.raises(InputError, match="on a line or plane"):
        WaveData(points, 1e-6 * np.ones((1, 9, 2)), [0.0], 1000.0, "isotropic", "elastic", poisson=0.3)


def test_noise_has_the_size_asked_for_and_is_the_seeds():
    points = grid(80, 80, spacing=1e-3)
    u = np.stack([1e-5 * np.sin(200 * points[:, 0]), 3e-6 * np.cos(90 * points[:, 1])], axis=1)[None] + 0j
    u[0, :100, 1] = np.nan
    data = WaveData(points, u, [50.0], 1000.0, "isotropic", "elastic", poisson=0.4)
    noisy = data.with_noise(0.05, seed=3)
    added = noisy.displacement - data.displacement
    for part in (0, 1):
        rms = np.sqrt(np.nanmean(np.abs(u[0, :, part]) ** 2))
        for side in (added.real, added.imag):
            assert np.nanstd(side[0, :, part]) == pytest.approx(0.05 * rms / np.sqrt(2), rel=0.04)
    edge = np.abs(added[0, data.dirichlet, 0])
    assert np.isnan(added[0, :100, 1]).all() and (edge > 0).all() and noisy.noise == 0.05
    assert np.array_equal(noisy.displacement, data.with_noise(0.05, 3).displacement, equal_nan=True)
    assert not np.array_equal(noisy.displacement, data.with_noise(0.05, 4).displacement, equal_nan=True)
    assert noisy.with_noise(0.12, 1).noise == pytest.approx(0.13)


def test_noise_is_relative_to_the_waves_in_the_mask():
    points = grid(20, 20, spacing=5e-3)
    inside = points[:, 0] < 0.03
    u = np.where(inside[:, None], [1e-5, 2e-5], 0)[None] + 0j  # as images have it: nothing where no tissue is
    data = WaveData(points, u, [50.0], 1000.0, "isotropic", "elastic", poisson=0.4, mask=inside)
    assert data.rms.ravel().tolist() == pytest.approx([1e-5, 2e-5])


def test_the_truth_under_the_names_of_the_answers():
    data = space()
    shear = data.truth["shear"]
    assert data.truth_views["storage"] == pytest.approx(shear.real) and data.truth_views["loss"] == pytest.approx(
        shear.imag
    )
    elastic = space(rheology="elastic", truth={"shear": shear.real})
    assert elastic.truth_views["youngs"] == pytest.approx(2.98 * shear.real)
    by_bulk = replace(
        elastic, poisson=None, bulk=1e5, truth={"youngs": elastic.truth_views["youngs"]}, rheology="viscoelastic"
    )
    E = elastic.truth_views["youngs"]
    nu = 0.5 - E / 6e5
    assert by_bulk.truth_views["storage"] == pytest.approx(E / (2 * (1 + nu))) and not by_bulk.truth_views["loss"].any()
    assert list(plane().truth_views) == ["mu", "zeta", "phi", "storage", "loss"]
    more = {**plane().truth, "shear": plane().truth["mu"]}
    for truth in (plane().truth, more):  # fibres have no Young's modulus
        assert list(replace(plane(), rheology="elastic", truth=truth).truth_views) == ["mu", "zeta", "phi"]
    lossy = replace(plane(), rheology="viscoelastic", truth={**plane().truth, "mu": (1 + 0.2j) * plane().truth["mu"]})
    assert lossy.truth_views["loss"] == pytest.approx(0.2 * lossy.truth_views["storage"])


def keys_of(path):
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"density": None}, "density is missing"),
        ({"fibre_angle_deg": 30.0}, "fibre_angle_deg is given beside fibre"),
        ({"fibre": None, "fibre_angle_deg": np.zeros(7)}, "finite degrees"),
        ({"symmetry": 3}, "text"),
        ({"pois": 0.3, "poison": 0.3}, "did you mean 'poisson'"),
        ({"truth_young": np.ones(30)}, "did you mean 'truth_youngs'"),
        ({"labels": np.array([{}] * 30, object)}, "without pickles"),
    ],
)
def test_a_wrong_file_is_named_with_its_key(change, says, tmp_path):
    path = tmp_path / "waves.npz"
    write_waves(path, plane())
    keys = {**keys_of(path), **change}
    np.savez(path, **{name: value for name, value in keys.items() if value is not None})
    with pytest.raises(InputError) as error:
        read_waves(path)
    assert str(error.value).startswith(f"{path}: ") and says in str(error.value)


def test_an_angle_is_a_fibre_and_other_keys_are_left_alone(tmp_path):
    path = tmp_path / "waves.npz"
    write_waves(path, plane(element=None))
    keys = {**keys_of(path), "fibre_angle_deg": np.float64(30), "comment": np.str_("by hand"), "element": np.str_("")}
    del keys["fibre"]
    np.savez(path, **keys)
    found = read_waves(path)
    assert found.fibre == pytest.approx(np.tile([np.sqrt(0.75), 0.5], (30, 1))) and found.element is None


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".nii", ".nii.gz"])
def test_damaged_files_are_refused_by_name(suffix, tmp_path, rng):
    """Truncated files, flipped bytes, random bytes: a one-line error, or data that pass every check."""
    path = tmp_path / f"waves{suffix}"
    write_waves(path, plane())
    whole, refused = path.read_bytes(), 0
    trials = 30 if suffix == ".h5" else 150  # each of these is looked at in a process of its own first
    for trial in range(trials):
        raw = bytearray(whole)
        if trial % 3 == 0:
            raw = raw[: rng.integers(len(raw))]
        elif trial % 3 == 1:
            for at in rng.integers(len(raw), size=8):
                raw[at] = rng.integers(256)
        else:
            start = rng.integers(len(raw))
            raw[start : start + 64] = rng.bytes(64)
        path.write_bytes(raw)
        try:
            read_waves(path)
        except NgbrainError as error:
            refused += 1
            assert isinstance(error, InputError) and "\n" not in str(error) and str(tmp_path) in str(error)
    assert refused >= trials // 3  # all that are cut short


@pytest.mark.parametrize(
    "text", ["", "[", "[1]", '{"frequency": [50, 60]}', '{"files": {"mask": "../../x.nii"}}', "{" * 10**5]
)
def test_a_damaged_sidecar_is_refused_by_name(text, tmp_path):
    write_waves(tmp_path / "waves.nii", plane())
    (tmp_path / "waves.json").write_text(text)
    with pytest.raises(InputError) as error:
        read_waves(tmp_path / "waves.nii")
    assert str(error.value).startswith(f"{tmp_path}/waves.")


def test_what_is_no_file_or_of_no_known_kind(tmp_path):
    for name in ("missing.npz", "missing.nii", "waves.mat", "waves"):
        with pytest.raises(InputError, match=name):
            read_waves(tmp_path / name)
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(InputError, match="a folder"):
        read_waves(tmp_path / "folder.npz")
    with pytest.raises(InputError, match="one array"):
        np.save(tmp_path / "one.npy", np.zeros(3))
        (tmp_path / "one.npy").rename(tmp_path / "one.npz")
        read_waves(tmp_path / "one.npz")
    with pytest.raises(InputError, match="damaged, or no archive"):
        write_waves(tmp_path / "waves.npz", plane())
        (tmp_path / "waves.npz").write_bytes(b"????" + (tmp_path / "waves.npz").read_bytes()[4:])
        read_waves(tmp_path / "waves.npz")
    with pytest.raises(InputError, match="points is no grid"):
        off = grid(6, 5) + 1e-4 * np.random.default_rng(0).normal(size=(30, 2))
        write_waves(tmp_path / "waves.nii", replace(plane(), points=off, element=None))


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "waves.h5"
    write_waves(path, plane())
    old = path.read_bytes()

    def full(*_):
        raise OSError("no room")

    monkeypatch.setattr(h5py.Group, "__setitem__", full)
    with pytest.raises(OSError, match="no room"):
        write_waves(path, space())
    assert path.read_bytes() == old and [each.name for each in tmp_path.iterdir()] == ["waves.h5"]


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="octave is not here")
def test_octave_reads_and_writes_waves(tmp_path):
    write_waves(tmp_path / "from.mat", plane())
    keep = "save('-v7', 'to.mat', '-struct', 'w')"
    script = f"w = load('from.mat'); disp(size(w.displacement)); w.displacement = 2 * w.displacement; {keep}"
    done = subprocess.run(
        ["octave-cli", "--quiet", "--no-init-file", "--eval", script], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.split() == ["2", "30", "2"], done.stderr
    assert_same(replace(plane(), displacement=2 * plane().displacement), read_waves(tmp_path / "to.mat"))


@pytest.mark.parametrize("loads", [1, 2])
def test_motion_through_a_slice_without_its_last_axis(loads, tmp_path):
    points = grid(6, 5)
    u = 1e-5 * (np.sin(300 * points[:, 0]) + 1j * np.cos(300 * points[:, 1])) * np.arange(1, loads + 1)[:, None]
    given = {"density": 1000.0, "symmetry": "isotropic", "rheology": "viscoelastic", "motion": "anti_plane"}
    keys = {"points": points, "displacement": u, "frequency": np.full(loads, 50.0), **given}
    scipy.io.savemat(tmp_path / "w.mat", keys)
    assert np.array_equal(read_waves(tmp_path / "w.mat").displacement, u[..., None])


def anisotropic_image(tmp_path, **keys):
    """Waves in space as an image whose fibres come from another one: tensors on coarser voxels that are turned otherwise."""
    path = tmp_path / "waves.nii.gz"
    data = space(symmetry="transversely_isotropic", fibre=np.array([1.0, 0, 0]), truth={})
    write_waves(path, data)
    affine = np.diag([-3e3, 3e3, 3e3, 1e3]) / 1e3  # mm, the first axis to the left
    affine[:3, 3] = 1e3 * data.points.mean(axis=0) - affine[:3, :3] @ [9.5, 9.5, 9.5]
    centres = np.indices((20, 20, 20)).reshape(3, -1).T @ affine[:3, :3].T + affine[:3, 3]
    along = fibres_at(centres / 1e3)
    tensors = np.einsum("ni,nj->nij", along, along) + 0.2 * np.eye(3)
    six = tensors[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].reshape(20, 20, 20, 6)
    nibabel.save(nibabel.Nifti1Image(six, affine), tmp_path / "dti.nii.gz")
    sidecar = json.loads((tmp_path / "waves.json").read_text())
    sidecar["files"].pop("fibre")
    sidecar |= {"fibre_map": "dti.nii.gz", "fibre_map_convention": "mrtrix", **keys}
    (tmp_path / "waves.json").write_text(json.dumps({key: value for key, value in sidecar.items() if value != ""}))
    return path, data


def fibres_at(points):
    """Fibres that turn by some degrees over a millimetre, in all three axes."""
    a = np.column_stack([np.cos(60 * points[:, 1]), np.sin(60 * points[:, 1]), 30 * points[:, 0]])
    return a / np.linalg.norm(a, axis=1)[:, None]


def test_fibres_of_a_diffusion_image(tmp_path):
    path, data = anisotropic_image(tmp_path)
    cosine = np.abs(np.sum(read_waves(path).fibre * fibres_at(data.points), axis=1))
    assert np.degrees(np.arccos(np.clip(cosine, 0, 1))).max() < 0.5


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"fibre_map": "../dti.nii.gz"}, "the name of an image in the same folder"),
        ({"fibre_map": ""}, "fibre_map is missing"),
        ({"fibre_map_convention": "fls"}, "one of fsl, mrtrix, nifti"),
        ({"fibre_map_convention": ""}, "one of fsl, mrtrix, nifti"),
        ({"fibre_angle_deg": 10.0}, "given beside fibre_angle_deg"),
        ({"fibre_map": "elsewhere.nii.gz"}, "without a direction at 100% of the measured points"),
    ],
)
def test_fibre_images_that_are_refused(keys, message, tmp_path):
    path, _ = anisotropic_image(tmp_path, **keys)
    image = nibabel.load(tmp_path / "dti.nii.gz")
    away = image.affine.copy()
    away[:3, 3] += 500.0  # mm
    nibabel.save(nibabel.Nifti1Image(image.get_fdata(), away), tmp_path / "elsewhere.nii.gz")
    with pytest.raises(InputError, match=message):
        read_waves(path)


@pytest.mark.parametrize("name", ["ce_bimaterial", "cv_gaussian", "ne_gaussian", "ti_double"])
def test_the_published_data_sets_are_read(name):
    here = Path(__file__).parent.parent
    folder = next((up / MATNLI for up in (here.parent, here.parent.parent) if (up / MATNLI).exists()), None)
    if folder is None:
        pytest.skip(f"{MATNLI} is not here")
    data = read_waves(folder / f"{name}.npz")
    assert data.grid.shape[0] in (51, 81, 101) and data.element in ("q4", "q4p0")
    expected = {"ce_bimaterial": ["youngs"], "cv_gaussian": ["storage", "loss"], "ne_gaussian": ["youngs"]}
    assert list(data.truth_views) == expected.get(name, ["mu", "zeta", "phi"])
    if name == "ti_double":
        assert data.fibre[0] == pytest.approx([np.sqrt(0.75), 0.5])
