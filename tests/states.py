"""Laws at many deformation gradients at once, as arrays: F (n, 3, 3)."""

import numpy as np

from ngbrain.materials import Deformation, density
from ngbrain.materials.points import Points


def _at(F):
    F = np.asarray(F, float).reshape(-1, 9)
    points = Points.line(len(F))
    return points, points.field(F.T.copy()).Reshape((3, 3)).MakeVariable()


def energy(law, F):
    """W, (n,)."""
    points, at = _at(F)
    return points(density(law, Deformation.from_gradient(at)))[0]


def stress(law, F):
    """Nominal stress ∂W/∂F, (n, 3, 3)."""
    points, at = _at(F)
    return points(density(law, Deformation.from_gradient(at)).Diff(at)).T.reshape(-1, 3, 3)


def tangent(law, F):
    """∂²W/∂F∂F, (n, 9, 9)."""
    points, at = _at(F)
    return points(density(law, Deformation.from_gradient(at)).Diff(at).Diff(at)).T.reshape(-1, 9, 9)


def cauchy(law, F):
    """Cauchy stress less a pressure, (n, 3, 3), of an incompressible body without traction along z."""
    F = np.asarray(F, float).reshape(-1, 3, 3)
    sigma = stress(law, F) @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None]
    return sigma - sigma[:, 2:, 2:] * np.eye(3)


def some(rng, n, size=0.15):
    """Deformation gradients (n, 3, 3) near 1 with a change of volume."""
    return np.eye(3) + size * rng.uniform(-1, 1, (n, 3, 3))


def turn(axis, angle):
    """The rotation about an axis."""
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
