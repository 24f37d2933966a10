"""Approximate anatomy of the MNI152 template: lines, tubes and ellipsoids, as markers for segmentation.

All coordinates are in mm of the symmetric template that nilearn ships (ICBM 2009a; right, front, up from the anterior
commissure), rounded to whole millimetres. They separate what is surely inside from what is surely outside; the boundaries
themselves come from the subject's scan. Tentorium, corpus callosum and ventricles were measured on the template; the outline of
the brain stem, and positions and sizes of the nuclei, were set by comparison with atlases in MNI space (neuromorphometrics).
Centres of nuclei are within 3 mm of Tzourio-Mazoyer et al. 2002, doi:10.1006/nimg.2001.0978.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

Points = np.ndarray

# Height of the tentorium: rows by y, columns by |x|. In front of the cerebellum it continues below the temporal lobes.
_AWAY = (0, 5, 10, 15, 20, 30, 40, 50, 60)
_TENTORIUM = {
    -22: (-90, -90, -90, -90, -90, -90, -90, -90, -90),
    -28: (-28, -28, -26, -26, -26, -45, -60, -70, -80),
    -34: (-2, -6, -12, -16, -20, -28, -38, -50, -60),
    -46: (0, 0, -6, -12, -16, -22, -26, -30, -40),
    -58: (4, 0, -6, -10, -14, -20, -22, -24, -32),
    -70: (-8, -10, -10, -14, -14, -18, -20, -24, -32),
    -82: (-20, -18, -18, -18, -18, -20, -24, -30, -38),
    -94: (-30, -28, -26, -25, -25, -28, -34, -40, -45),
    -106: (-45, -45, -42, -40, -40, -42, -45, -50, -55),
}
# Outline of the brain stem: z, half width, back and front.
_STEM = np.array(
    [
        (3, 9, -36, -22),
        (-4, 13, -38, -22),
        (-10, 16, -41, -20),
        (-16, 18, -40, -17),
        (-20, 18, -39, -13),
        (-25, 18, -41, -11),
        (-30, 19, -42, -11),
        (-35, 18, -43, -12),
        (-40, 17, -43, -14),
        (-45, 15, -44, -17),
        (-50, 13, -46, -23),
        (-55, 12, -47, -29),
        (-60, 10, -48, -31),
        (-65, 8, -48, -33),
        (-72, 7, -48, -36),
    ],
    float,
)
# Line through the back of the mammillary bodies and the posterior commissure, y and z: the diencephalon is above it.
_TOP = np.array([(-14.0, -18.0), (-27.0, 2.0)])
# Corpus callosum in the mid plane, from the rostrum over the genu to the splenium, y and z.
CALLOSUM = np.array([(12, -5), (24, -3), (31, 8), (24, 19), (10, 25), (-10, 27), (-25, 23), (-36, 15), (-38, 8)], float)
# Centre line of the right lateral ventricle, from frontal to occipital horn and into the temporal horn: x, y, z and radius.
_VENTRICLE = (
    np.array(
        [
            (16, 32, 2, 3.5),
            (10, 24, 6, 4),
            (8, 16, 12, 4.5),
            (7, 6, 17, 5),
            (7, -6, 20, 5),
            (9, -18, 21, 5),
            (15, -28, 20, 5),
            (20, -36, 16, 6),
            (25, -45, 9, 6),
            (28, -56, 5, 3.5),
        ],
        float,
    ),
    np.array([(25, -45, 9, 6), (31, -41, 0, 3), (34, -28, -12, 2.5), (33, -14, -19, 2.5)], float),
)


def tentorium(points: Points) -> np.ndarray:
    """Height (n,) of the tentorium at points (n, 3), extended to the mid line and the skull.

    >>> tentorium(np.array([[0, -58, 0], [-40.0, -64, 0]]))
    array([ 4., -21.])
    """
    rows = sorted(_TENTORIUM)
    table = np.array([_TENTORIUM[y] for y in rows], float)
    at = np.stack([points[:, 1].clip(rows[0], rows[-1]), np.abs(points[:, 0]).clip(0, _AWAY[-1])], axis=1)
    return np.asarray(scipy.interpolate.RegularGridInterpolator((rows, _AWAY), table)(at))


def stem(points: Points) -> tuple[np.ndarray, np.ndarray]:
    """Distance (n,) of points (n, 3) from the axis of the brain stem, 1 on its outline, and depth (n,) in mm below its upper end.

    >>> np.round(stem(np.array([[0, -26.5, -30], [19, -26.5, -30]])), 1)
    array([[ 0., 1.], [17., 17.]])
    """
    z = -points[:, 2]
    half, back, front = (np.interp(z, -_STEM[:, 0], column) for column in _STEM[:, 1:].T)
    radius = np.hypot(points[:, 0] / half, (points[:, 1] - (back + front) / 2) / ((front - back) / 2))
    (y0, z0), along = _TOP[0], _TOP[1] - _TOP[0]
    normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    return radius, (points[:, 1] - y0) * normal[0] + (points[:, 2] - z0) * normal[1]


def ventricle(points: Points) -> np.ndarray:
    """Distance (n,) of points (n, 3) from the centre line of the nearer lateral ventricle, relative to its radius there.

    >>> ventricle(np.array([[7.0, 6, 17], [-7, 6, 22], [50, 0, 0]])).round(1)
    array([0. , 1. , 8.3])
    """
    right = points * [1.0, 1, 1]
    right[:, 0] = np.abs(points[:, 0])
    best = np.full(len(points), np.inf)
    for course in _VENTRICLE:
        for a, b in pairwise(course):
            line = b[:3] - a[:3]
            along = ((right - a[:3]) @ line / (line @ line)).clip(0, 1)
            radius = a[3] + along * (b[3] - a[3])
            best = np.minimum(best, np.linalg.norm(right - a[:3] - along[:, None] * line, axis=1) / radius)
    return best


@dataclass(frozen=True)
class Nucleus:
    """An ellipsoid on the right side; its mirror image is on the left.

    Parameters
    ----------
    centre : tuple of float
        (3,) mm.
    axes : tuple
        (3, 3) directions as rows: short, middle and long axis.
    half : tuple of float
        (3,) semi-axes (mm).
    core : float
        Radius inside which all tissue belongs to the nucleus.
    reach : float
        Radius outside which no tissue does.
    """

    centre: tuple[float, float, float]
    axes: tuple[tuple[float, float, float], ...]
    half: tuple[float, float, float]
    core: float
    reach: float

    def radius(self, points: Points) -> np.ndarray:
        """Radius (n,) of points (n, 3) relative to the nearer of the two ellipsoids, 1 on its surface.

        >>> NUCLEI["thalamus"].radius(np.array([[12, -18, 6], [-12.0, -18, 6]]))
        array([0., 0.])
        """
        right = points * [1, 1, 1]
        right[:, 0] = np.abs(points[:, 0])
        turn, _ = np.linalg.qr(np.array(self.axes).T[:, ::-1])  # the long axis is exact, the others are orthogonalised
        return np.linalg.norm((right - self.centre) @ turn[:, ::-1] / self.half, axis=1)


NUCLEI = {
    "caudate": Nucleus((13, 12, 10), ((0.9, -0.2, -0.3), (-0.4, -0.6, -0.7), (-0.1, 0.7, -0.7)), (6, 10, 27), 0.7, 1.4),
    "putamen": Nucleus((26, 3, 0), ((0.9, 0.3, -0.1), (0.0, -0.3, -0.9), (-0.3, 0.9, -0.3)), (7, 13, 23), 0.7, 1.25),
    "pallidum": Nucleus((21, -1, -1), ((0.8, 0.6, -0.1), (0.1, 0.1, 1.0), (-0.6, 0.8, 0.0)), (5, 7, 14), 0.9, 1.15),
    "thalamus": Nucleus((12, -18, 6), ((0.9, 0.4, 0.1), (0.0, -0.2, 1.0), (-0.4, 0.9, 0.2)), (11, 12, 22), 0.9, 1.2),
}


# Free margin of the falx around y = 5, z = 0: angle (degrees, from front to up) and distance (mm). It runs from the crista
# galli, 5 mm above the corpus callosum, to the straight sinus behind the splenium.
_MIDDLE = np.array([5.0, 0.0])
_MARGIN = np.array(
    [(-24, 58), (0, 42), (17, 33), (45, 33), (79, 31), (119, 36), (143, 42), (160, 48), (210, 50)], float
)


def free_margin(where: Points) -> np.ndarray:
    """Distance (mm) of points y, z (..., 2) of the mid plane outside the free margin of the falx; negative inside it.

    >>> free_margin(np.array([[5.0, 60.0], [5.0, 0.0]])).round(0)
    array([ 28., -42.])
    """
    at = where - _MIDDLE
    angle = np.degrees(np.arctan2(at[..., 1], at[..., 0]))
    angle = np.where(angle < -90, angle + 360, angle)
    inside = np.interp(angle, *_MARGIN.T)
    open_below = (angle < _MARGIN[0, 0]) | (angle > _MARGIN[-1, 0])
    return np.asarray(np.where(open_below, -1.0, np.linalg.norm(at, axis=-1) - inside))
