"""Labels from closed surfaces: volumes, cavities, either orientation, one in the other."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.image.segment.from_surfaces import labels_from_surfaces
from ngbrain.mesh.surface.mask_surface import contour
from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh


def ball(radius, centre=(0.0, 0.0, 0.0)):
    """mm, of triangles of 1.5 mm."""
    n = int(radius / 1.5) + 2
    points, triangles = contour(np.linalg.norm(np.indices((2 * n + 1,) * 3) - n, axis=0) < radius / 1.5)
    points = points - n
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    return SurfaceMesh(1e-3 * (points + centre), triangles)


def test_regions_have_the_volumes_of_their_surfaces():
    outer, left, right = ball(60), ball(15, (-20.3, 3.1, 2.4)), ball(15, (20.6, 3.4, 1.6))
    labels = labels_from_surfaces([("brain", outer), ("ventricles", left), ("ventricles", right)])
    assert labels.regions == ("brain", "ventricles")
    assert labels.volumes_ml()["ventricles"] == pytest.approx(1e6 * (left.volume + right.volume), rel=2e-3)
    assert sum(labels.volumes_ml().values()) == pytest.approx(1e6 * outer.volume, rel=1e-3)
    at = labels.volume.to_world(np.argwhere(labels.volume.data == 2))
    assert at.mean(axis=0) == pytest.approx([0.15e-3, 3.25e-3, 2e-3], abs=1e-5)


def test_a_cavity_stays_and_the_orientation_does_not_matter():
    outer, inner = ball(60), ball(20)
    both = SurfaceMesh(
        np.concatenate([outer.points, inner.points]),
        np.concatenate([outer.triangles, inner.triangles + len(outer.points)]),
    )
    wanted = 1e6 * (outer.volume - inner.volume)
    assert labels_from_surfaces([("shell", both)]).volumes_ml()["shell"] == pytest.approx(wanted, rel=2e-3)
    turned = SurfaceMesh(both.points, both.triangles[:, ::-1])
    assert np.array_equal(
        labels_from_surfaces([("shell", turned)]).volume.data, labels_from_surfaces([("shell", both)]).volume.data
    )


def test_small_bodies_have_finer_voxels():
    labels = labels_from_surfaces([("phantom", ball(12))])
    assert labels.volume.spacing == pytest.approx(0.24e-3, rel=0.01)
    assert labels.volumes_ml()["phantom"] == pytest.approx(1e6 * ball(12).volume, rel=3e-3)


def test_a_surface_between_voxels_is_refused():
    with pytest.raises(InputError, match="surface speck is around no voxel"):
        labels_from_surfaces(
            [("brain", ball(60)), ("speck", SurfaceMesh(1e-4 * ball(2).points + 1.3e-4, ball(2).triangles))]
        )
