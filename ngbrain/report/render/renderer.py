"""A small renderer: shaded triangles with a depth buffer in orthographic projection, so that scale bars hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SUPERSAMPLING = 2
_CHUNK = 2_000_000
_LIGHTS = ((np.array([-0.45, 0.55, 0.70]), 0.62), (np.array([0.6, -0.1, 0.79]), 0.22))  # in the camera's axes
_AMBIENT = 0.30


@dataclass(frozen=True)
class Camera:
    """An orthographic camera.

    Parameters
    ----------
    centre : ndarray, shape (3,)
        Centre of the picture (m).
    right, up, toward : ndarray, shape (3,)
        Unit vectors to the picture's right, to its top and to the viewer.
    half_width, half_height : float
        Half the size of the picture (m).
    """

    centre: Floats
    right: Floats
    up: Floats
    toward: Floats
    half_width: float
    half_height: float

    @classmethod
    def look_at(cls, centre: Floats, toward: Floats, up: Floats, half_width: float, half_height: float) -> Camera:
        """A camera with the `up` nearest to a given direction.

        Parameters
        ----------
        centre : ndarray, shape (3,)
            Centre of the picture (m).
        toward : ndarray, shape (3,)
            Direction to the viewer.
        up : ndarray, shape (3,)
            Direction to the top.
        half_width, half_height : float
            Half the size of the picture (m).

        Returns
        -------
        Camera
            The camera.
        """
        toward = toward / np.linalg.norm(toward)
        right = np.cross(up, toward)
        right = right / np.linalg.norm(right)
        return cls(centre, right, np.cross(toward, right), toward, half_width, half_height)

    def project(self, points: Floats) -> Floats:
        """Transform points (n, 3) to (right, up, toward) from the centre (m)."""
        return np.asarray((np.asarray(points) - self.centre) @ np.column_stack([self.right, self.up, self.toward]))


@dataclass(frozen=True)
class Layer:
    """Triangles with a common appearance.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    triangles : ndarray of int, shape (m, 3)
        Triangles.
    colour : ndarray
        Red, green, blue (3,), one for each vertex (n, 3), or values (n,) for the palette.
    normals : ndarray, shape (n, 3), optional
        Vertex normals; None for flat shading.
    opacity : float
        1, or less for a translucent surface seen face-on; its rim is denser.
    clip : ndarray, shape (n,), optional
        Nothing is drawn where it is negative.
    shine : float
        Specular part of the light.
    lit : float
        Strength of the shading; 0 for the plain colour.
    palette : callable, optional
        Interpolated values of `colour` → colours (k, 3).
    """

    points: Floats
    triangles: Ints
    colour: Floats
    normals: Floats | None = None
    opacity: float = 1.0
    clip: Floats | None = None
    shine: float = 0.0
    lit: float = 1.0
    palette: Callable[[Floats], Floats] | None = None


@dataclass(frozen=True)
class _Hits:
    """For each pixel: depth, triangle (-1 for none) and barycentric coordinates."""

    depth: Floats
    triangle: Ints
    bary: Floats


def draw(camera: Camera, layers: list[Layer], width: int, height: int) -> npt.NDArray[np.uint8]:
    """Render layers on white; translucent layers lie over the opaque ones behind them.

    Parameters
    ----------
    camera : Camera
        The camera.
    layers : list of Layer
        The layers.
    width, height : int
        Size of the picture (pixels).

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        The picture.
    """
    w, h = SUPERSAMPLING * width, SUPERSAMPLING * height
    image = np.ones((w * h, 3))
    depth = np.full(w * h, -np.inf)
    for layer in sorted(layers, key=lambda one: one.opacity < 1):
        hits = _rasterise(camera, layer, w, h)
        seen = np.flatnonzero((hits.triangle >= 0) & (hits.depth > depth))
        colour, alpha = _shade(camera, layer, hits.triangle[seen], hits.bary[seen])
        image[seen] += alpha[:, None] * (colour - image[seen])
        if layer.opacity >= 1:
            depth[seen] = hits.depth[seen]
    fine = image.reshape(height, SUPERSAMPLING, width, SUPERSAMPLING, 3).mean(axis=(1, 3))
    return (255 * np.clip(fine, 0, 1) + 0.5).astype(np.uint8)


def _rasterise(camera: Camera, layer: Layer, w: int, h: int) -> _Hits:
    at = camera.project(layer.points)
    x = (at[:, 0] / camera.half_width + 1) / 2 * w - 0.5
    y = (1 - at[:, 1] / camera.half_height) / 2 * h - 0.5
    corners = np.stack([x, y, at[:, 2]], axis=1)[layer.triangles]
    low = np.clip(np.ceil(corners[:, :, :2].min(axis=1)), 0, [w, h]).astype(int)
    high = np.clip(np.floor(corners[:, :, :2].max(axis=1)) + 1, 0, [w, h]).astype(int)
    size = np.maximum(high - low, 0)
    number = size.prod(axis=1)
    (a, b, c) = np.moveaxis(corners, 1, 0)
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    rows = np.flatnonzero((number > 0) & (np.abs(twice) > 1e-12))
    hits = _Hits(np.full(w * h, -np.inf), np.full(w * h, -1), np.zeros((w * h, 3)))
    for chunk in np.split(rows, np.flatnonzero(np.diff(np.cumsum(number[rows]) // _CHUNK)) + 1):
        t = np.repeat(chunk, number[chunk])
        start = np.repeat(np.cumsum(number[chunk]) - number[chunk], number[chunk])
        k = np.arange(len(t)) - start
        px, py = low[t, 0] + k % size[t, 0], low[t, 1] + k // size[t, 0]
        u = ((px - a[t, 0]) * (c[t, 1] - a[t, 1]) - (c[t, 0] - a[t, 0]) * (py - a[t, 1])) / twice[t]
        v = ((b[t, 0] - a[t, 0]) * (py - a[t, 1]) - (px - a[t, 0]) * (b[t, 1] - a[t, 1])) / twice[t]
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
        t, u, v, pixel = t[inside], u[inside], v[inside], (py * w + px)[inside]
        bary = np.stack([1 - u - v, u, v], axis=1)
        if layer.clip is not None:
            kept = np.einsum("ij,ij->i", bary, layer.clip[layer.triangles[t]]) >= 0
            t, bary, pixel = t[kept], bary[kept], pixel[kept]
        z = np.einsum("ij,ij->i", bary, corners[t, :, 2])
        np.maximum.at(hits.depth, pixel, z)
        first = z == hits.depth[pixel]
        hits.triangle[pixel[first]] = t[first]
        hits.bary[pixel[first]] = bary[first]
    return hits


def _shade(camera: Camera, layer: Layer, triangle: Ints, bary: Floats) -> tuple[Floats, Floats]:
    nodes = layer.triangles[triangle]
    if layer.palette is not None:
        colour = layer.palette(np.einsum("ij,ij->i", bary, layer.colour[nodes]))
    elif layer.colour.ndim == 1:
        colour = np.broadcast_to(layer.colour, (len(nodes), 3))
    else:
        colour = np.einsum("ij,ijk->ik", bary, layer.colour[nodes])
    if layer.lit == 0:
        return colour, np.full(len(nodes), layer.opacity)
    if layer.normals is None:
        p, q, r = np.moveaxis(layer.points[nodes], 1, 0)
        normal = np.cross(q - p, r - p)
    else:
        normal = np.einsum("ij,ijk->ik", bary, layer.normals[nodes])
    normal = normal @ np.column_stack([camera.right, camera.up, camera.toward])
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    normal = normal * np.where(normal[:, 2:] < 0, -1, 1)  # both sides are lit
    light = np.full(len(nodes), _AMBIENT)
    mirrored = np.zeros(len(nodes))
    for direction, strength in _LIGHTS:
        direction = direction / np.linalg.norm(direction)
        light += strength * np.maximum(normal @ direction, 0)
        half = direction + np.array([0, 0, 1.0])
        mirrored += strength * np.maximum(normal @ (half / np.linalg.norm(half)), 0) ** 40
    light = 1 + layer.lit * (light - 1)
    shaded = colour * light[:, None] + layer.shine * mirrored[:, None]
    alpha = (
        layer.opacity + (1 - layer.opacity) * (1 - normal[:, 2]) ** 2.5 if layer.opacity < 1 else np.ones(len(nodes))
    )
    return shaded, alpha
