"""Surfaces of other programs: coordinates, units, closedness."""

import meshio
import nibabel
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.io.surfacefile import is_surface, read_surface
from ngbrain.mesh.surface.mask_surface import contour

CENTRE = np.array([5.0, -18.0, 32.0])


@pytest.fixture(scope="module")
def ellipsoid():
    """Points (mm, float32) and triangles."""
    away = np.linalg.norm((np.indices((41, 41, 41)) - 20) / np.array([15, 18, 12])[:, None, None, None], axis=0)
    points, triangles = contour(away < 1)
    return (4 * (points - 20)).astype(np.float32), triangles


def checked(surface, ellipsoid, shift=(0, 0, 0)):
    points, triangles = ellipsoid
    assert len(surface.points) == len(points) and len(surface.triangles) == len(triangles)
    assert surface.points.mean(axis=0) == pytest.approx(1e-3 * (points.mean(axis=0) + shift), abs=1e-6)
    assert surface.volume == pytest.approx(4 / 3 * np.pi * 15 * 18 * 12 * 64e-9, rel=0.02)
    assert surface.genus == 0


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".off"])
def test_formats_of_meshio(ellipsoid, suffix, tmp_path):
    path = tmp_path / f"brain{suffix}"
    meshio.Mesh(ellipsoid[0].astype(float), [("triangle", ellipsoid[1])]).write(path)
    assert is_surface(path)
    checked(read_surface(path), ellipsoid)


def test_freesurfers_surfaces_lie_where_their_scan_is(ellipsoid, tmp_path):
    volume = {
        "head": [2, 0, 20], "valid": "1  # volume info valid", "filename": "orig.mgz", "volume": [256, 256, 256],
        "voxelsize": [1.0, 1.0, 1.0], "xras": [-1.0, 0, 0], "yras": [0, 0, -1.0], "zras": [0, 1.0, 0], "cras": CENTRE,
    }  # fmt: skip
    nibabel.freesurfer.write_geometry(tmp_path / "lh.pial", *ellipsoid, volume_info=volume)
    assert is_surface(tmp_path / "lh.pial")
    checked(read_surface(tmp_path / "lh.pial", "m"), ellipsoid, CENTRE)  # its unit is known


def test_gifti_in_the_scans_and_in_freesurfers_coordinates(ellipsoid, tmp_path):
    points, triangles = ellipsoid
    moved = np.eye(4)
    moved[:3, 3] = CENTRE
    for name, matrix, meta in (
        ("plain", np.eye(4), {}),
        ("moved", moved, {}),
        ("freesurfer", np.eye(4), dict(zip(("VolGeomC_R", "VolGeomC_A", "VolGeomC_S"), map(str, CENTRE), strict=True))),
    ):
        arrays = [
            nibabel.gifti.GiftiDataArray(
                points,
                "NIFTI_INTENT_POINTSET",
                coordsys=nibabel.gifti.GiftiCoordSystem(1, 1, matrix),
                meta=nibabel.gifti.GiftiMetaData(meta),
            ),
            nibabel.gifti.GiftiDataArray(triangles.astype(np.int32), "NIFTI_INTENT_TRIANGLE"),
        ]
        path = tmp_path / f"{name}.surf.gii"
        nibabel.save(nibabel.gifti.GiftiImage(darrays=arrays), path)
        assert is_surface(path)
        checked(read_surface(path), ellipsoid, (0, 0, 0) if name == "plain" else CENTRE)


def test_what_is_open_or_no_surface_or_in_another_unit(ellipsoid, tmp_path):
    points, triangles = ellipsoid
    path = tmp_path / "open.stl"
    meshio.Mesh(points.astype(float), [("triangle", triangles[1:])]).write(path)
    with pytest.raises(
        InputError, match=r"open.stl: surface is open at 3 edges, the first at \(.*\) mm; wanted: a closed"
    ):
        read_surface(path)
    meshio.Mesh(1e-3 * points.astype(float), [("triangle", triangles)]).write(path)
    with pytest.raises(InputError, match=r"unit is mm, in which the body is 0.00014 m wide; .* as it is in m"):
        read_surface(path)
    checked(read_surface(path, "m"), ellipsoid)
    path.write_bytes(b"solid")
    with pytest.raises(InputError, match=r"open.stl: surface file is "):
        read_surface(path)
    (tmp_path / "scan.nii").write_bytes(b"\x5c\x01\x00\x00")
    assert not is_surface(tmp_path / "scan.nii") and not is_surface(tmp_path / "none")
