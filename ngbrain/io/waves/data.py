"""Validated displacement data of a harmonic or quasi-static experiment."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from ngbrain.errors import InputError, nearest
from ngbrain.io.waves.grid import Grid, hull
from ngbrain.io.waves.labelled import wave_dataset, wave_variables
from ngbrain.look import NotebookCard, scatter

SYMMETRIES = ("isotropic", "transversely_isotropic")
RHEOLOGIES = ("elastic", "viscoelastic")
ELEMENTS = ("q4", "q4p0")
TISSUES = ("brain", "liver", "breast", "muscle", "phantom")
MOTIONS = ("in_plane", "anti_plane")
TRUTHS = ("youngs", "shear", "mu", "zeta", "phi")
_LARGEST = 2.0  # m, across all points
_DENSITY = (100.0, 20000.0)  # kg/m³
_MOVED, _STILL = 10.0, 1e-12  # times the size of the region
_NOISIEST = 10.0
_POSITIVE = ("youngs", "shear", "mu")


@dataclass(frozen=True, eq=False, repr=False)
class WaveData(NotebookCard):
    """Displacements u(x, t) = Re(u(x) e^{iωt}) at points, and known properties of the material.

    Parameters
    ----------
    points : numpy.ndarray
        (n, d) m, d = 2 or 3.
    displacement : numpy.ndarray
        (loads, n, d) complex, m; NaN where a component is not measured. (loads, n, 1) for anti-plane motion.
    frequency : numpy.ndarray
        (loads,) Hz; 0 is quasi-static.
    density : float
        Density (kg/m³).
    symmetry : str
        "isotropic" or "transversely_isotropic".
    rheology : str
        "elastic" or "viscoelastic".
    poisson : float, optional
        Poisson's ratio, above -1 and below 0.5; this or `bulk`. Anti-plane viscoelastic data need neither.
    bulk : complex, optional
        Bulk modulus (Pa), real or complex; this or `poisson`.
    fibre : numpy.ndarray, optional
        (n, d) unit vectors, or one vector (d,) for all points; needed if transversely isotropic.
    element : str, optional
        "q4" or "q4p0" if the data were computed with these elements on the grid of the points.
    dirichlet : numpy.ndarray, optional
        (n,) bool, boundary points with prescribed displacements; the rest of the boundary is traction-free. By default the
        boundary of the mask; to be given again (or None) with another mask.
    mask : numpy.ndarray, optional
        (n,) bool, points that are used; by default all.
    noise : float or numpy.ndarray, optional
        Noise of the displacement relative to the rms of each component: one number, or (n,) numbers above 0 (arbitrary outside
        the mask); None if unknown.
    labels : numpy.ndarray, optional
        (n,) integers from 0 on.
    truth : mapping, optional
        Name → (n,): youngs, shear (complex), mu (Pa), zeta, phi.
    affine : numpy.ndarray, optional
        (4, 4), from voxel indices of the image to m, if the points are its voxels.
    motion : str, optional
        For plane points "in_plane" (plane strain) or "anti_plane", one component normal to the plane; None in 3-D.
    tissue : str, optional
        "brain", "liver", "breast", "muscle" or "phantom"; moduli outside its range cause a warning.

    Raises
    ------
    InputError
        A field has another shape or type, is not finite or out of range; points coincide; points or displacements cannot be in
        m; a load is 0 everywhere; both or neither of `poisson` and `bulk` are given; `fibre` is missing; `element` or `affine`
        is given although the points are not a (coordinate-aligned) grid.

    Examples
    --------
    >>> grid = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> u = 1e-6 * np.ones((1, 9, 2))
    >>> data = WaveData(grid, u, [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> data.dim, data.loads, data.grid.shape, int(data.dirichlet.sum())
    (2, 1, (3, 3), 8)
    >>> WaveData(1000 * grid, u, [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    Traceback (most recent call last):
    ngbrain.errors.InputError: points is 20 across; wanted: metres: at most 2 m
    """

    points: np.ndarray
    displacement: np.ndarray
    frequency: np.ndarray
    density: float
    symmetry: str
    rheology: str
    poisson: float | None = None
    bulk: complex | None = None
    fibre: np.ndarray | None = None
    element: str | None = None
    dirichlet: np.ndarray = None  # type: ignore[assignment]
    mask: np.ndarray = None  # type: ignore[assignment]
    noise: float | np.ndarray | None = None
    labels: np.ndarray | None = None
    truth: Mapping[str, np.ndarray] = field(default_factory=dict)
    affine: np.ndarray | None = None
    motion: str | None = None
    tissue: str | None = None

    def __post_init__(self) -> None:
        known = {
            "symmetry": SYMMETRIES,
            "rheology": RHEOLOGIES,
            "element": (None, *ELEMENTS),
            "motion": (None, *MOTIONS),
        }
        known["tissue"] = (None, *TISSUES)
        for name, values in known.items():
            value = getattr(self, name)
            if not (value is None or isinstance(value, str)) or value not in values:
                raise InputError(name, repr(value)[:200], nearest(str(value), [each for each in values if each]))
        self._check_points()
        self._check_motion()
        self._check_displacement()
        n = len(self.points)
        mask = np.ones(n, bool) if self.mask is None else _flags("mask", self.mask, n)
        if not mask.any():
            raise InputError("mask", "false everywhere", "some points that count")
        self._set(mask=mask)
        for load, known in enumerate(self.measured & mask[:, None]):
            if known.any() and not self.displacement[load][known].any():
                raise InputError("displacement", f"0 everywhere in load {load}", "a body that moves")
        self._check_material()
        self._check_grid()
        self._set(dirichlet=self.border if self.dirichlet is None else _flags("dirichlet", self.dirichlet, n))
        if self.noise is not None:
            self._set(noise=_noise("noise", self.noise, mask))
        if self.labels is not None:
            labels = _array("labels", self.labels, (n,), "fiub")
            if not (np.isfinite(labels) & (labels == np.rint(labels)) & (labels >= 0)).all():
                raise InputError("labels", "not whole or negative somewhere", "whole numbers from 0 on")
            self._set(labels=labels.astype(np.int32))
        self._set(truth={name: self._true(name, values) for name, values in dict(self.truth or {}).items()})

    def _set(self, **fields: Any) -> None:
        for name, value in fields.items():
            object.__setattr__(self, name, value)  # the class is frozen

    def _check_points(self) -> None:
        points = _array("points", self.points, (None, (2, 3)), "fiu").astype(float)
        if not np.isfinite(points).all():
            raise InputError("points", f"not finite in {int((~np.isfinite(points)).any(axis=1).sum())} rows", "numbers")
        if len(points) < points.shape[1] + 1:
            raise InputError("points", f"{len(points)} points", f"at least {points.shape[1] + 1}")
        across = float(np.ptp(points, axis=0).max())
        if across > _LARGEST:
            raise InputError("points", f"{across:.6g} across", f"metres: at most {_LARGEST:g} m")
        self._set(points=points)
        if self.grid is None:
            near = KDTree(points).query(points, k=2)[0][:, 1]
            if near.min() <= 1e-9 * across:
                raise InputError("points", f"twice the same, point {int(near.argmin())}", "every point once")

    def _check_motion(self) -> None:
        if self.motion and self.dim == 3:
            raise InputError("motion", repr(self.motion), "left out for points in space")
        if self.dim == 2:
            self._set(motion=self.motion or "in_plane")
        if self.motion == "anti_plane" and self.symmetry != "isotropic":
            raise InputError(
                "symmetry", self.symmetry, "isotropic: anti-plane motion does not determine the anisotropy"
            )

    def _check_displacement(self) -> None:
        n, d = len(self.points), len(self.components)
        given = self.displacement
        if isinstance(given, np.ndarray) and given.ndim == 3 and given.shape[2] == 1 < d == 2:
            raise InputError("motion", self.motion, "anti_plane for one component, the motion through the plane")
        u = _array("displacement", given, (None, n, d), "fiuc").astype(complex)
        if not len(u):
            raise InputError("displacement", "of no load", "at least one")
        if np.isinf(u).any():
            raise InputError("displacement", "infinite somewhere", "m, NaN where it is not measured")
        for load, each in enumerate(u):
            if np.isnan(each).all():
                raise InputError("displacement", f"NaN everywhere in load {load}", "a measured component")
        across = float(np.ptp(self.points, axis=0).max())
        # Computed waves near a resonance may exceed the body, as the theory is linear; wrong units exceed it by far more.
        if (most := float(np.nanmax(np.abs(u)))) > _MOVED * across:
            wanted = f"metres: below {_MOVED * across:.6g} m, {_MOVED:g} times the size of the region"
            raise InputError("displacement", f"{most:.6g} at most", f"{wanted}; or displacement_unit says mm or um")
        if 0 < most < _STILL * across:
            raise InputError("displacement", f"{most:.6g} at most", f"metres: above {_STILL * across:.6g} m somewhere")
        frequency = _array("frequency", self.frequency, (len(u),), "fiu").astype(float)
        if not (np.isfinite(frequency) & (frequency >= 0)).all():
            raise InputError("frequency", frequency.tolist(), "Hz, at least 0")
        self._set(displacement=u, frequency=frequency)

    def _check_material(self) -> None:
        wanted = f"kg/m³, from {_DENSITY[0]:g} to {_DENSITY[1]:g}"
        self._set(density=_number("density", self.density, *_DENSITY, wanted))
        needless = self.motion == "anti_plane" and self.rheology == "viscoelastic" and self.poisson is self.bulk is None
        if (self.poisson is None) == (self.bulk is None) and not needless:
            found = "missing" if self.poisson is None else "given twice, by bulk too"
            raise InputError("poisson", found, "either poisson or bulk (Pa)")
        if self.poisson is not None:
            poisson = _number("poisson", self.poisson, -1.0, 0.5, "a number above -1 and below 0.5")
            if poisson in (-1.0, 0.5):
                raise InputError("poisson", poisson, "a number above -1 and below 0.5")
            self._set(poisson=poisson)
        if self.bulk is not None:
            bulk = complex(_array("bulk", self.bulk, (), "fiuc", "one number, Pa"))
            if not (np.isfinite(bulk) and bulk.real > 0 and bulk.imag >= 0):
                raise InputError("bulk", bulk, "Pa, above 0, its imaginary part at least 0")
            self._set(bulk=bulk if bulk.imag else bulk.real)
        if self.fibre is not None:
            n, d = self.points.shape
            one = to_array("fibre", self.fibre).ndim == 1
            fibre = np.broadcast_to(_array("fibre", self.fibre, (d,) if one else (n, d), "fiu").astype(float), (n, d))
            length = np.linalg.norm(fibre, axis=1)
            off = self.mask & ~(np.abs(length - 1) < 1e-3)
            if off.any():
                raise InputError("fibre", f"of length {length[off][0]:.6g} at point {off.argmax()}", "unit vectors")
            self._set(fibre=np.where(self.mask[:, None], fibre / np.where(self.mask, length, 1)[:, None], fibre))
        elif self.symmetry == "transversely_isotropic":
            raise InputError("fibre", "missing", "unit vectors of the fibres, or fibre_angle_deg in the plane")

    def _check_grid(self) -> None:
        grid = self.grid
        if self.element and not (grid and grid.is_axis_aligned and self.dim == 2):
            wanted = "points on a plane grid along x and y, numbered along x first, or no element"
            raise InputError("element", self.element, wanted)
        if self.affine is not None:
            self._set(affine=_array("affine", self.affine, (4, 4), "fiu").astype(float))
            if grid is None:
                raise InputError(
                    "affine", "given", "points on a grid, numbered along its first axis first, or no affine"
                )

    def _true(self, name: str, values: Any) -> np.ndarray:
        if name not in TRUTHS:
            raise InputError("truth", repr(name), nearest(name, TRUTHS))
        values = _array(f"truth_{name}", values, (len(self.points),), "fiuc")
        wanted = "numbers" + (" (Pa), their real part above 0" if name in _POSITIVE else "")
        bad = ~np.isfinite(values) | ((values.real <= 0) if name in _POSITIVE else False)
        if (bad & self.mask).any():
            raise InputError(f"truth_{name}", values[bad & self.mask][0], wanted)
        return values

    def summary(self) -> dict[str, str]:
        """Size, frequencies and material in words."""
        where = "plane" if self.dim == 2 else "space"
        hertz = ", ".join(f"{f:g}" for f in np.unique(self.frequency))
        words = {
            "points": f"{len(self.points)} points in {'the ' if self.dim == 2 else ''}{where}",
            "loads": f"{self.loads} load{'s' if self.loads > 1 else ''}",
            "frequency": f"{hertz} Hz",
            "amplitude": f"{1e6 * float(np.max(self.rms)):.3g} µm rms",
            "material": f"{self.symmetry}, {self.rheology}",
        }
        return words | ({"tissue": self.tissue} if self.tissue else {})

    def plot(self) -> Any:
        """Amplitude of the first load (µm); in space that of the middle layer."""
        amplitude = np.sqrt(np.nansum(np.abs(self.displacement[0]) ** 2, axis=1))
        return scatter(self.points, 1e6 * amplitude, "|u| (µm)")

    def to_xarray(self) -> Any:
        """As `xarray.Dataset`: displacement (complex, m), mask, labels and true properties, on a grid along x, y, z."""
        return wave_dataset(self, wave_variables(self))

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write a file (.npz, .h5, .hdf5, .mat, .nii, .nii.gz) that `read_waves` restores; returns its path."""
        from ngbrain.io.waves.files import write_waves  # reads what is defined here

        write_waves(path, self)
        return Path(path)

    @property
    def dim(self) -> int:
        """Dimension, 2 or 3."""
        return self.points.shape[1]

    @property
    def components(self) -> str:
        """Names of the displacement components: xyz, xy, or z for anti-plane motion."""
        return "z" if self.motion == "anti_plane" else "xyz"[: self.dim]

    @property
    def loads(self) -> int:
        """Number of displacement fields."""
        return len(self.displacement)

    @cached_property
    def grid(self) -> Grid | None:
        """Grid of the points, or None if they are scattered."""
        return Grid.from_points(self.points)

    @cached_property
    def point_spacing(self) -> float:
        """Median distance (m) of a point of the mask to its nearest neighbour."""
        points = self.points[self.mask]
        return float(np.median(KDTree(points).query(points, k=2)[0][:, 1]))

    @cached_property
    def border(self) -> np.ndarray:
        """(n,) bool: boundary points of the mask, see `hull`."""
        return hull(self.points, self.grid, self.mask)

    @property
    def measured(self) -> np.ndarray:
        """(loads, n, d) bool: measured components."""
        return ~np.isnan(self.displacement)

    @property
    def rms(self) -> np.ndarray:
        """(loads, 1, d) m: rms of |u| over the measured points of the mask, per component; 0 where there are none."""
        counts = self.measured & self.mask[:, None]
        size = np.where(counts, np.abs(self.displacement), 0)
        return np.sqrt((size**2).sum(axis=1, keepdims=True) / np.maximum(counts.sum(axis=1, keepdims=True), 1))

    @property
    def truth_views(self) -> dict[str, np.ndarray]:
        """The truth under the names of results: youngs, or storage and loss (Pa), or mu, zeta, phi.

        Isotropic: G from `shear`, or from `youngs` E by `poisson` ν, G = E/2(1+ν), or by `bulk` K, G = 3KE/(9K-E). Elastic: E
        from G. Viscoelastic: storage = Re G, loss = Im G; with fibres those of mu.
        """
        views = {name: self.truth[name] for name in ("mu", "zeta", "phi") if name in self.truth}
        shear, youngs = self.truth.get("shear"), self.truth.get("youngs")
        if self.symmetry != "isotropic" and self.rheology == "viscoelastic":
            shear, youngs = self.truth.get("mu", shear), None
        elif self.symmetry != "isotropic":
            return views
        if shear is None and youngs is None:
            return views
        if self.rheology == "elastic":
            return {**views, "youngs": np.real(self.youngs_of(shear) if youngs is None else youngs)}
        shear = self.shear_of(youngs) if shear is None else shear
        return {**views, "storage": np.real(shear), "loss": np.imag(shear)}

    def youngs_of(self, shear: Any) -> Any:
        """Young's modulus (Pa) from the shear modulus G (Pa): 2G(1 + ν), or 9KG/(3K + G)."""
        if self.bulk is None:
            return 2 * shear * (1 + float(self.poisson or 0))
        return 9 * self.bulk * shear / (3 * self.bulk + shear)

    def shear_of(self, youngs: Any) -> Any:
        """Shear modulus (Pa) from Young's modulus E (Pa): the inverse of `youngs_of`."""
        if self.bulk is None:
            return youngs / (2 * (1 + float(self.poisson or 0)))
        return 3 * self.bulk * youngs / (9 * self.bulk - youngs)

    def conjugate(self) -> WaveData:
        """The same waves in the time convention e^{-iωt}: the displacement is conjugated."""
        return replace(self, displacement=np.conj(self.displacement))

    def lacks_imaginary(self, noise: float) -> bool:
        """Whether viscoelastic waves are in phase everywhere up to noise (relative to their rms), so that the loss is not
        identifiable.
        """
        moving = np.nan_to_num(self.displacement[self.frequency > 0][:, self.mask])
        size = np.sum(np.abs(moving) ** 2, axis=(1, 2))
        out_of_phase = (
            size - np.abs(np.sum(moving**2, axis=(1, 2)))
        ) / 2  # of each load, at the phase that leaves the least
        lacking = np.sum(out_of_phase) <= (noise**2 + 1e-12) * np.sum(size)  # plus round-off
        return self.rheology == "viscoelastic" and moving.size > 0 and bool(lacking)

    def with_noise(self, sigma: float | np.ndarray, seed: int) -> WaveData:
        """Add noise η = σ · rms(component) · (a + ib)/√2 to every measured value, boundary included.

        a and b are independent standard normal numbers, drawn for all loads, points and components in that order; the rms is
        that of |u| over the measured points of the mask, per component and load. η is complex also for elastic data. `noise`
        becomes σ, or √(noise² + σ²) if the data had noise.

        Parameters
        ----------
        sigma : float or numpy.ndarray
            Relative noise σ, one number or (n,) as `noise`.
        seed : int
            Seed of the random numbers.

        Returns
        -------
        WaveData

        Raises
        ------
        InputError
            Unless 0 ≤ σ ≤ 10, and σ > 0 where it is given for each point.

        Examples
        --------
        >>> grid = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
        >>> data = WaveData(grid, 1e-6 * np.ones((1, 9, 2)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
        >>> data.with_noise(0.02, seed=0).noise
        0.02
        """
        sigma = _noise("sigma", sigma, self.mask)
        a, b = np.random.default_rng(seed).standard_normal((2, *self.displacement.shape))
        noisy = self.displacement + np.reshape(sigma, (-1, 1)) * self.rms * (a + 1j * b) / np.sqrt(2)
        noise = np.hypot(0.0 if self.noise is None else self.noise, sigma)
        return replace(self, displacement=noisy, noise=noise)


def _array(name: str, value: Any, shape: tuple[Any, ...], kinds: str, wanted: str = "") -> np.ndarray:
    """An array of given type codes and shape: None is any length, a tuple one of several."""
    array = to_array(name, value, wanted)
    fits = array.ndim == len(shape) and all(
        want is None or (size in want if isinstance(want, tuple) else size == want)
        for size, want in zip(array.shape, shape, strict=True)
    )
    if not fits or array.dtype.kind not in kinds:
        sizes = [
            "n" if want is None else "|".join(map(str, want)) if isinstance(want, tuple) else str(want)
            for want in shape
        ]
        number = "numbers" if "c" in kinds else "booleans" if kinds == "b" else "real numbers"
        found = f"{array.dtype} of shape {array.shape}"
        raise InputError(name, found, wanted or f"{number} of shape ({', '.join(sizes)})")
    return array


def to_array(name: str, value: Any, wanted: str = "") -> np.ndarray:
    """Convert a value to an array.

    Parameters
    ----------
    name : str
        Name of the value, for messages.
    value : array_like
        The value.
    wanted : str, optional
        What is accepted, in words.

    Returns
    -------
    numpy.ndarray

    Raises
    ------
    InputError
        The value is a ragged sequence.
    """
    try:
        return np.asarray(value)
    except (ValueError, TypeError) as error:
        raise InputError(name, f"a {type(value).__name__}", wanted or "an array of numbers") from error


def _number(name: str, value: Any, low: float, high: float, wanted: str) -> float:
    number = float(_array(name, value, (), "fiu", wanted))
    if not low <= number <= high:
        raise InputError(name, number, wanted)
    return number


def _noise(name: str, value: Any, mask: np.ndarray) -> float | np.ndarray:
    if to_array(name, value).ndim == 0:
        return _number(name, value, 0.0, _NOISIEST, "relative, from 0 on (0.02: two per cent)")
    n = len(mask)
    array = _array(name, value, (n,), "fiu", f"one number, relative (0.02: two per cent), or {n}, one for each point")
    array = array.astype(float)
    bad = mask & ~((array > 0) & (array <= _NOISIEST))
    if bad.any():
        wanted = f"relative, above 0 and at most {_NOISIEST:g} at every point of the mask"
        raise InputError(name, f"{array[bad][0]:.6g} at point {bad.argmax()}", wanted)
    return np.where(array > 0, array, 1.0)  # values outside the mask are arbitrary


def _flags(name: str, value: Any, n: int) -> np.ndarray:
    flags = _array(name, value, (n,), "biuf", f"true or false for each of the {n} points")
    if not np.isin(flags, (0, 1)).all():
        raise InputError(name, "neither 0 nor 1 somewhere", "true or false for every point")
    return flags.astype(bool)
