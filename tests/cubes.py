"""A mesh route from outside the package: every voxel is a cube of six tetrahedra."""

import numpy as np

from ngbrain.mesh.routes.registry import LabelMesh
from ngbrain.mesh.tet_mesh import named_elements


def cubes(labels, size):
    """Six tetrahedra for each voxel of a label that is not cut away: no element is smaller, none follows a surface."""
    numbers = labels.region_numbers()
    at = np.argwhere(numbers)
    steps = np.array([[i >> k & 1 for k in range(3)] for i in range(8)])
    corners = at[:, None] + steps
    flat, tets = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    kuhn = np.array([[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]])
    tets = tets.reshape(-1, 8)[:, kuhn].reshape(-1, 4)
    affine = labels.volume.affine
    points = (flat - 0.5) @ affine[:3, :3].T + affine[:3, 3]
    volume = np.linalg.det(points[tets[:, 1:]] - points[tets[:, :1]])
    tets[volume > 0] = tets[volume > 0][:, [1, 0, 2, 3]]
    region = np.repeat(numbers[tuple(at.T)].astype(int) - 1, 6)
    return LabelMesh(named_elements(points, tets, region, labels.regions))
