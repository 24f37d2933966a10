"""Families of random stiffness maps on the unit square: moduli relative to a background of about 1.

A family is a function of a random generator and coordinates x, y (any shape, 0 to 1). It returns an array of that
shape, above 0.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from ngbrain.errors import InputError, nearest

Array = np.ndarray
Family = Callable[[np.random.Generator, Array, Array], Array]
CONTRAST = (0.4, 3.0)
"""Range of moduli of sharp inclusions, relative to the background."""
BUMP = (-0.4, 1.5)
"""Range of the amplitude of smooth inclusions, relative to the background."""


def gaussian_place(random: np.random.Generator, x: Array, y: Array) -> Array:
    """Gaussian inclusion 1 + a exp(-r²/2w²) of the published width w = 0.118 at a random position.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    x, y : numpy.ndarray
        Coordinates, 0 to 1.

    Returns
    -------
    numpy.ndarray
        Relative modulus, of the same shape.
    """
    return _spot(random, x, y, 0.118)


def gaussian_width(random: np.random.Generator, x: Array, y: Array) -> Array:
    """Gaussian inclusion 1 + a exp(-r²/2w²) of width w from 0.07 to 0.2 at a random position.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    x, y : numpy.ndarray
        Coordinates, 0 to 1.

    Returns
    -------
    numpy.ndarray
        Relative modulus, of the same shape.
    """
    return _spot(random, x, y, random.uniform(0.07, 0.2))


def _spot(random: np.random.Generator, x: Array, y: Array, width: float) -> Array:
    a, (cx, cy) = random.uniform(*BUMP), random.uniform(0.2, 0.8, 2)
    return 1 + a * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * width**2))


def sinusoidal(random: np.random.Generator, x: Array, y: Array) -> Array:
    """Sinusoidal modulus 1 + a sin(2π(k x + φ)) sin(2π(l y + ψ)), k and l from 0.5 to 1.5, a up to 0.5.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    x, y : numpy.ndarray
        Coordinates, 0 to 1.

    Returns
    -------
    numpy.ndarray
        Relative modulus, of the same shape.
    """
    a, (k, l), (p, q) = random.uniform(0.1, 0.5), random.uniform(0.5, 1.5, 2), random.uniform(0, 1, 2)
    return 1 + a * np.sin(2 * np.pi * (k * x + p)) * np.sin(2 * np.pi * (l * y + q))


def sinc(random: np.random.Generator, x: Array, y: Array) -> Array:
    """Sinc inclusion 1 + a sin(πr/w)/(πr/w), w from 0.12 to 0.3.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    x, y : numpy.ndarray
        Coordinates, 0 to 1.

    Returns
    -------
    numpy.ndarray
        Relative modulus, of the same shape.
    """
    a, w, (cx, cy) = random.uniform(*BUMP), random.uniform(0.12, 0.3), random.uniform(0.2, 0.8, 2)
    return 1 + a * np.sinc(np.hypot(x - cx, y - cy) / w)


def inclusions(random: np.random.Generator, x: Array, y: Array) -> Array:
    """One to three inclusions with sharp edges: ellipses, polygons, stars.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    x, y : numpy.ndarray
        Coordinates, 0 to 1.

    Returns
    -------
    numpy.ndarray
        Relative modulus, of the same shape.
    """
    field = np.ones_like(x)
    for _ in range(random.integers(1, 4)):
        field[_inside(random, x, y, random.uniform(0.07, 0.2))] = _contrast(random)
    return field


def tumour(random: np.random.Generator, x: Array, y: Array) -> Array:
    """Irregular mass, stiff or soft, with its own core and a graded rim, in tissue that varies by a tenth.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    x, y : numpy.ndarray
        Coordinates, 0 to 1.

    Returns
    -------
    numpy.ndarray
        Relative modulus, of the same shape.
    """
    size, (cx, cy) = random.uniform(0.12, 0.25), random.uniform(0.3, 0.7, 2)
    angle, far = np.arctan2(y - cy, x - cx), np.hypot(x - cx, y - cy)
    edge = np.ones_like(x)
    for wave in range(2, 8):  # rougher masses have more of the higher waves
        edge += random.normal() * 0.25 / wave * np.cos(wave * angle + random.uniform(0, 2 * np.pi))
    within = 1 / (1 + np.exp((far / (size * np.maximum(edge, 0.3)) - 1) * size / random.uniform(0.005, 0.03)))
    core = 1 / (1 + np.exp((far / (0.5 * size) - 1) * size / 0.02))
    mass = _contrast(random)
    return _uneven(random, x, y, 0.1) * (1 + (mass - 1) * within + random.uniform(-0.3, 0.3) * mass * core)


def halves(random: np.random.Generator, x: Array, y: Array) -> Array:
    """Two materials that meet along a straight line of random direction.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    x, y : numpy.ndarray
        Coordinates, 0 to 1.

    Returns
    -------
    numpy.ndarray
        Relative modulus, of the same shape.
    """
    angle, shift = random.uniform(0, 2 * np.pi), random.uniform(-0.25, 0.25)
    return np.where((x - 0.5) * np.cos(angle) + (y - 0.5) * np.sin(angle) > shift, _contrast(random), 1.0)


def slices(random: np.random.Generator, x: Array, y: Array) -> Array:
    """Squares of 120 mm from slices of the average brain, with random tissue stiffness and a lesion in half of them.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    x, y : numpy.ndarray
        Coordinates, 0 to 1.

    Returns
    -------
    numpy.ndarray
        Relative modulus, of the same shape.

    Raises
    ------
    MissingExtra
        The packages that read and segment images are not installed.
    """
    labels = _brain()
    z = random.integers(labels.shape[2])
    side = 120  # voxels of 1 mm
    corner = [random.integers(max(1, n - side)) for n in labels.shape[:2]]
    i, j = (np.clip(c + side * t, 0, n - 1).astype(int) for c, t, n in zip(corner, (x, y), labels.shape, strict=False))
    # Outside, fluid, grey, white, ventricles: all but tissue have the lowest modulus of inclusions.
    stiffness = np.array([0.4, 0.4, *random.uniform(0.7, 1.6, 2), 0.4])
    field = stiffness[labels[i, j, z]]
    if random.random() < 0.5:
        field = np.where(_inside(random, x, y, random.uniform(0.07, 0.15)), _contrast(random), field)
    return field


FAMILIES: dict[str, Family] = {
    each.__name__: each
    for each in (gaussian_place, gaussian_width, sinusoidal, sinc, inclusions, tumour, halves, slices)
}
SMOOTH = ("gaussian_place", "gaussian_width", "sinusoidal", "sinc")
SHARP = ("inclusions", "halves")


def family(name: str) -> Family:
    """One of `FAMILIES`; `InputError` for another name.

    >>> x, y = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    >>> np.unique(family("halves")(np.random.default_rng(0), x, y)).size
    2
    """
    if name not in FAMILIES:
        raise InputError("family", repr(name), nearest(name, list(FAMILIES)))
    return FAMILIES[name]


def _contrast(random: np.random.Generator) -> float:
    """Log-uniform modulus in `CONTRAST`, at least a tenth away from the background."""
    while True:
        value = float(np.exp(random.uniform(*np.log(CONTRAST))))
        if abs(np.log(value)) > 0.1:
            return value


def _inside(random: np.random.Generator, x: Array, y: Array, size: float) -> Array:
    """Mask of an ellipse, polygon or star of about that radius at a random position."""
    (cx, cy), turn = random.uniform(0.2, 0.8, 2), random.uniform(0, 2 * np.pi)
    dx, dy = x - cx, y - cy
    u, v = np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx
    far, angle, kind = np.hypot(u, v), np.arctan2(v, u), random.integers(3)
    if kind == 0:
        return np.hypot(u / random.uniform(0.6, 1.0), v) < size
    corners = random.integers(3, 7)
    if kind == 1:
        part = np.pi / corners
        return far * np.cos(np.mod(angle, 2 * part) - part) < size * np.cos(part) * 1.1
    return far < size * (1 + random.uniform(0.1, 0.35) * np.cos(corners * angle))


def _uneven(random: np.random.Generator, x: Array, y: Array, most: float) -> Array:
    """1 plus a few long waves of random direction."""
    field = np.zeros_like(x)
    for _ in range(4):
        kx, ky = random.uniform(-2, 2, 2)
        field += random.normal() * np.cos(2 * np.pi * (kx * x + ky * y + random.random()))
    return 1 + most * field / max(1.0, float(np.abs(field).max()))


@cache
def _brain() -> Array:
    """Labels of the average brain from the floor of the ventricles to the crown, every third slice."""
    from ngbrain.image import mni152
    from ngbrain.image.labelling import label_tissues

    labels = label_tissues(mni152()).volume.data
    low, high = (int(f * labels.shape[2]) for f in (0.35, 0.7))
    return labels[:, :, low:high:3]
