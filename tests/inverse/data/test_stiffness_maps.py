"""Published maps of stiffness and damping ratio as moduli; small files made here in the format of MRE134."""

import zipfile

import ngsolve as ngs
import numpy as np
import pytest

pytest.importorskip("nibabel", reason='nibabel is not installed; get it with: pip install "ngbrain[mri]"')

from ngbrain.errors import InputError  # noqa: E402
from ngbrain.forward.common.interpolation import quadrature_points  # noqa: E402
from ngbrain.image.read.nifti import write_nifti  # noqa: E402
from ngbrain.image.read.volume import Volume  # noqa: E402
from ngbrain.inverse.data.stiffness_maps import read_stiffness  # noqa: E402
from ngbrain.mesh import block  # noqa: E402

PLACE = np.array([[-2e-3, 0, 0, 20e-3], [0, 2e-3, 0, -20e-3], [0, 0, 2e-3, -10e-3], [0, 0, 0, 1]])
SHAPE = (21, 21, 21)
MODULUS = 2000 + 800j
MU, XI = 2 * abs(MODULUS) ** 2 / (MODULUS.real + abs(MODULUS)), 0.2
"""Stiffness and damping ratio of that modulus, by the definitions of MRE134."""


def write(path, values: np.ndarray) -> str:
    """Write a map in a ZIP archive, float32, 0 where nothing was measured."""
    plain = path.with_suffix("")
    write_nifti(plain, Volume(values.astype(np.float32), PLACE))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(plain, plain.name)
        archive.writestr(f"__MACOSX/._{plain.name}", b"")
    return str(path)


@pytest.fixture
def files(tmp_path):
    """Files of a ball of 30 mm with that modulus in Pa, or in a unit of one's own; twice as stiff where x > 0."""

    def make(scale: float = 1.0) -> tuple[str, str]:
        x = np.einsum("ij,jklm->iklm", PLACE[:3, :3], np.indices(SHAPE)) + PLACE[:3, 3, None, None, None]
        ball = np.linalg.norm(x - np.array([0, 0, 10e-3])[:, None, None, None], axis=0) < 15e-3
        stiffness = np.where(ball, scale * MU * np.where(x[0] > 0, 2, 1), 0)
        return write(tmp_path / "s.nii.zip", stiffness), write(tmp_path / "d.nii.zip", np.where(ball, XI, 0))

    return make


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "Pa"), (1e-3, "kPa")])
def test_the_modulus_is_that_of_the_definitions_in_either_unit(files, scale, unit):
    points = np.array([[-6e-3, 0, 10e-3], [6e-3, 2e-3, 8e-3]])
    for given in (unit, None):
        found = read_stiffness(*files(scale), given)
        np.testing.assert_allclose(found.interpolate(points), [MODULUS, 2 * MODULUS], rtol=1e-6)
        assert unit in found.note.split() or f"for {unit} by its size" in found.note
        assert ("by its size" in found.note) == (given is None)
    known = ~np.isnan(found.modulus)
    assert known.sum() == (~np.isnan(found.stiffness.data)).sum() and known[10, 10, 10] and not known[0, 0, 0]


def test_a_wrong_unit_is_refused(files):
    with pytest.raises(InputError, match=r"s\.nii\.zip: stiffness is .* kPa in the median; wanted: 300 to 30000 Pa"):
        read_stiffness(*files(), "kPa")
    with pytest.raises(InputError, match=r"s\.nii\.zip: stiffness is .* Pa in the median; wanted: 300 to 30000 Pa"):
        read_stiffness(*files(1e-3), "Pa")
    with pytest.raises(InputError, match=r"stiffness is 0\.0\d+ in the median"):
        read_stiffness(*files(1e-5))  # neither unit


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_swapped_files_are_refused(files, scale):
    stiffness, damping = files(scale)
    with pytest.raises(InputError, match=r"s\.nii\.zip: damping_ratio is .* in the median; .*swapped\?"):
        read_stiffness(damping, stiffness)


def test_maps_on_other_voxels_are_refused(files, tmp_path):
    stiffness, _ = files()
    with pytest.raises(InputError, match="two maps on the same voxels"):
        read_stiffness(stiffness, write(tmp_path / "e.nii.zip", np.full((5, 5, 5), XI)))


def test_maps_off_the_head_are_refused_and_follow_a_registration(files):
    found = read_stiffness(*files())
    points = np.array([[-6e-3, 0, 10e-3], [6e-3, 2e-3, 8e-3]])
    away = np.eye(4)
    away[:3, 3] = 0.05, -0.03, 0.1
    with pytest.raises(InputError, match="map is without a value at 100% of the body"):
        found.interpolate(points + away[:3, 3])
    np.testing.assert_allclose(
        found.transform(away).interpolate(points + away[:3, 3]), found.interpolate(points), rtol=1e-6
    )


def test_the_soft_rim_of_a_mean_counts_as_not_measured(files, tmp_path):
    stiffness, damping = files()
    inner = read_stiffness(stiffness, damping)
    values = np.nan_to_num(inner.stiffness.data)
    values[10, 10, 10] = 5.0
    found = read_stiffness(write(tmp_path / "rim.nii.zip", values), damping)
    assert np.isnan(found.modulus[10, 10, 10]) and "below 300 Pa, count as not measured" in found.note
    middle = found.stiffness.to_world(np.array([[10, 10, 10], [9, 10, 10]]))
    assert found.interpolate(middle).real.min() > 1900


def test_fields_over_a_mesh_are_the_values_at_its_quadrature_points(files):
    found = read_stiffness(*files())
    mesh = block((0.01, 0.01, 0.01), 0.005)
    _, points = quadrature_points(mesh, 3)
    storage, loss = found.quadrature_fields(mesh, 3)
    np.testing.assert_allclose(storage.vec.FV().NumPy() + 1j * loss.vec.FV().NumPy(), found.interpolate(points))
    rule = ngs.dx(intrules=storage.space.GetIntegrationRules())
    assert float(ngs.Integrate(loss * rule, mesh) / ngs.Integrate(storage * rule, mesh)) == pytest.approx(
        2 * XI, rel=1e-5
    )
