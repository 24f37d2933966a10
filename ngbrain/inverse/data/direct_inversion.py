"""Stiffness straight from the waves: algebraic inversion of the wave equation, and local frequency estimation.

All methods assume a locally constant modulus, so they are wrong where it changes within a wavelength. They return complex
shear moduli G* (n,) Pa at the points of the data, NaN outside the mask and where nothing is measured. For elastic data the
imaginary part is 0. Quasi-static loads are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from scipy import fft
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.inverse.data.smooth_field import SmoothField
from ngbrain.inverse.data.smoothing import fit_smooth_field
from ngbrain.io.waves.data import WaveData
from ngbrain.io.waves.grid import Grid

STIFF = 10e3
"""Shear modulus (Pa) that is assumed where the waves suggest none, such as for quasi-static data."""
PARTS = 3
"""Parts of the points along each axis, whose loss tangents are compared."""
_OCTAVE = 2.0
_STEEPNESS = 1 / (2 * np.log(2))  # C of the filters: with centres an octave apart the ratio of two answers is k itself


def helmholtz(data: WaveData, field: SmoothField | None = None, window: float = 0.0) -> np.ndarray:
    """Algebraic inversion of G ∇²u = -ρω²u: at each point G = -Σ ρω² (∇²u)*·u / Σ |∇²u|².

    The sums go over all loads, frequencies and components; ω = 2π frequency. It needs waves without divergence: it takes
    pressure waves, or the pressure of nearly incompressible tissue, for shear waves. Then use `helmholtz_of_curl`.

    Parameters
    ----------
    data : WaveData
        Points, frequencies, density ρ and rheology.
    field : SmoothField, optional
        u and its derivatives; by default `fit_smooth_field(data)`.
    window : float
        Radius (m) of the ball over whose points the two sums go; 0 for the point alone.

    Returns
    -------
    numpy.ndarray
        (n,) G*, Pa.

    Raises
    ------
    InputError
        All loads are quasi-static, or `fit_smooth_field` fails.

    References
    ----------
    Oliphant et al. 2001, doi:10.1002/1522-2594(200102)45:2<299::AID-MRM1039>3.0.CO;2-O.

    Examples
    --------
    >>> points = np.array([[x, y] for y in range(20) for x in range(20)]) * 0.002
    >>> k = 2 * np.pi * 50 * np.sqrt(1000 / (2000 + 800j))
    >>> u = 1e-5 * np.stack([0 * points[:, 1], np.exp(-1j * k * points[:, 0])], axis=1)[None]
    >>> data = WaveData(points, u, [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.49)
    >>> complex(np.round(np.median(helmholtz(data))))
    (2000+800j)
    """
    field = field or fit_smooth_field(data)
    return _solve_pointwise(data, [field.laplacian(data.points)], field.values(data.points), window)[0]


@dataclass(frozen=True)
class UniformModulus:
    """One complex shear modulus for all tissue.

    Parameters
    ----------
    value : complex
        Pa.
    note : str
        A sentence where the modulus is an assumption, not an estimate from the waves.
    """

    value: complex
    note: str = ""


def uniform_shear(data: WaveData) -> float:
    """Return the magnitude (Pa) of `uniform_modulus`."""
    return abs(uniform_modulus(data).value)


def uniform_modulus(data: WaveData) -> UniformModulus:
    """Return one shear modulus for all tissue, as a start value and for the choice of elements. It is robust against a few bad
    points.

    It comes from the curl q = ∇×u (for anti-plane motion from u). At each point 1/G = -Σ ρω² q*·∇²q / Σ ρ²ω⁴ |q|², summed
    over loads and components. The estimate is the weighted median over the points, of the real and of the imaginary part. 1/G
    is used because noise is in ∇²q rather than in q; in an estimate of G itself, noise would count as softness. The weight of
    a point is its ρω² |q|, but at most that of the median point: plain least squares would be decided by the rim, where
    derivatives of a smooth field are least accurate. Elastic data have the real part alone.

    For quasi-static data, and where noise hides the waves, the modulus is `STIFF`, and the note says so.
    """
    if data not in _UNIFORM:
        _UNIFORM[data] = _uniform_modulus(data)
    return _UNIFORM[data]


_UNIFORM: WeakKeyDictionary[WaveData, UniformModulus] = WeakKeyDictionary()


def _uniform_modulus(data: WaveData) -> UniformModulus:
    kilopascal = f"{STIFF / 1e3:g} kPa"
    if not np.any(data.frequency > 0):
        return UniformModulus(STIFF, f"no load is a wave: the shear modulus starts from {kilopascal}, which is assumed")
    softness = _median_softness(data)
    if np.isfinite(softness) and softness.real > 0:
        return UniformModulus(complex(1 / softness) if data.rheology == "viscoelastic" else complex(1 / softness.real))
    note = "no shear modulus follows from the waves, which do not bend as shear waves do"
    return UniformModulus(STIFF, f"{note}: {kilopascal} is assumed for the start and for the size of elements")


def _median_softness(data: WaveData) -> complex:
    """1/G (1/Pa), see `uniform_modulus`; NaN where there is no curl."""
    softness, weight, _ = _softness(data)
    return _complex_median(softness, weight) if len(softness) else complex(np.nan)


def _softness(data: WaveData) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """1/G at points, their weights as in `uniform_modulus`, and the indices of these points.

    It uses the curl where it is known. Where no load has two components it uses the displacement, which is wrong with
    pressures.
    """
    field, moving, counts = fit_smooth_field(data), data.frequency > 0, np.flatnonzero(data.mask)
    turning = bool((np.isfinite(data.displacement[:, counts]).any(axis=1).sum(axis=1) > 1).any())
    q, bent = (field.curl(), field.curl_laplacian()) if turning else (field.values(), field.laplacian())
    q = data.density * (2 * np.pi * data.frequency[moving, None, None]) ** 2 * q[moving][:, counts]
    against = np.nansum(np.abs(q) ** 2, axis=(0, 2))
    sums = np.nansum(np.conj(q) * bent[moving][:, counts], axis=(0, 2))
    known = (against > 0) & np.isfinite(sums)
    weight = np.sqrt(against[known])
    weight = np.minimum(weight, np.median(weight)) if len(weight) else weight
    return -sums[known] / against[known], weight, counts[known]


def _complex_median(values: np.ndarray, weight: np.ndarray) -> complex:
    return complex(_weighted_median(values.real, weight), _weighted_median(values.imag, weight))


def loss_tangent(data: WaveData) -> tuple[float, float]:
    """Return the loss tangent G''/G' that the waves suggest for all tissue, and its standard error.

    It comes from 1/G as in `uniform_modulus`, because noise does not bias its imaginary part. The standard error comes from
    `PARTS` parts of the points along each axis. Below 0 the waves gain energy. Both are NaN for quasi-static data and where
    no modulus follows.
    """
    if not np.any(data.frequency > 0):
        return np.nan, np.nan
    softness, weight, points = _softness(data)
    if not len(softness):
        return np.nan, np.nan
    middle = _complex_median(softness, weight)
    if not middle.real > 0:
        return np.nan, np.nan
    at = data.points[points]
    parts = split_points(at)
    tangents = np.array([-_weighted_median(softness.imag[each], weight[each]) / middle.real for each in parts])
    return -middle.imag / middle.real, float(tangents.std(ddof=1) / np.sqrt(len(parts))) if len(parts) > 1 else np.inf


def split_points(points: np.ndarray) -> list[np.ndarray]:
    """Return which points (n,) are in each of `PARTS` parts along every axis; empty parts are left out."""
    along = np.ptp(points, axis=0).clip(1e-300)
    part = np.minimum((PARTS * (points - points.min(axis=0)) / along).astype(int), PARTS - 1)
    number = part @ PARTS ** np.arange(points.shape[1])
    return [number == each for each in np.unique(number)]


def local_moduli(data: WaveData) -> np.ndarray:
    """Return complex moduli (Pa) at the points (n,), from 1/G as in `uniform_modulus`; NaN where none follow.

    Raises `InputError` as `fit_smooth_field`.
    """
    softness, _, points = _softness(data)
    found = np.full(len(data.points), np.nan, complex)
    found[points] = 1 / softness
    return found


def _weighted_median(values: np.ndarray, weight: np.ndarray) -> float:
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def helmholtz_of_curl(data: WaveData, field: SmoothField | None = None, window: float = 0.0) -> np.ndarray:
    """`helmholtz` for q = ∇×u in place of u: the curl of ∇p and of pressure waves is 0.

    It takes third derivatives: the field has to be smooth, such as moving least squares of degree 3 at least.

    Parameters
    ----------
    data : WaveData
        Points, frequencies, density ρ and rheology.
    field : SmoothField, optional
        u and its derivatives; by default `fit_smooth_field(data)`.
    window : float
        Radius (m) of the ball over whose points the two sums go; 0 for the point alone.

    Returns
    -------
    numpy.ndarray
        (n,) G*, Pa.
    """
    field = field or fit_smooth_field(data)
    return _solve_pointwise(data, [field.curl_laplacian(data.points)], field.curl(data.points), window)[0]


def navier(data: WaveData, field: SmoothField | None = None, window: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Algebraic inversion of G ∇²u + (λ + G) ∇(∇·u) = -ρω²u with both moduli free.

    In nearly incompressible tissue ∇(∇·u) is hardly more than noise, and only G is meaningful.

    Parameters
    ----------
    data : WaveData
        Points, frequencies, density ρ and rheology.
    field : SmoothField, optional
        u and its derivatives; by default `fit_smooth_field(data)`.
    window : float
        Radius (m) of the ball over whose points the two sums go; 0 for the point alone.

    Returns
    -------
    G, rest : numpy.ndarray
        (n,) G and λ + G, Pa.

    Raises
    ------
    InputError
        As `helmholtz`.
    """
    field = field or fit_smooth_field(data)
    hessian = field.hessian(data.points)
    laplacian, dilatation = np.einsum("lnikk->lni", hessian), np.einsum("lnkki->lni", hessian)
    G, rest = _solve_pointwise(data, [laplacian, dilatation], field.values(data.points), window)
    return G, rest


def local_frequency(data: WaveData) -> np.ndarray:
    """Local frequency estimation: |G*| ≈ ρω²/k² with the local wave number k of the displacement.

    The waves pass quadrature filters R_i(|k|) D_j(k/|k|). R_i = exp(-ln²(|k|/k_i)/(2 ln 2)) has centres k_i an octave apart.
    D_j is the square of the cosine to direction j where that is positive. With q_i the root of the sum of squares over
    directions, components and loads of a frequency,

        k = Σ_i q_i q_{i+1} √(k_i k_{i+1}) q_{i+1}/q_i  /  Σ_i q_i q_{i+1} ,

    where each term is exact for a plane wave. Frequencies are weighted by their energies. The method needs no derivative, so
    no smoothing. Its resolution is about a wavelength. It is inaccurate near the border, and where waves cross.

    Raises `InputError` if the points are no grid, or all loads are quasi-static.

    References
    ----------
    Knutsson, Westin & Granlund 1994, doi:10.1109/ICIP.1994.413270; Manduca et al. 2001, doi:10.1016/S1361-8415(00)00039-6.

    Examples
    --------
    >>> points = np.array([[x, y] for y in range(40) for x in range(60)]) * 0.002
    >>> u = 1e-5 * np.stack([0 * points[:, 1], np.exp(-1j * 200 * points[:, 0])], axis=1)[None]
    >>> data = WaveData(points, u, [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> bool(abs(np.median(local_frequency(data)).real / (1000 * (2 * np.pi * 50 / 200) ** 2) - 1) < 0.03)
    True
    """
    grid = data.grid
    if grid is None:
        raise InputError("points", "scattered", "a grid")
    slowness, total = np.zeros(grid.shape), np.zeros(grid.shape)
    for frequency in np.unique(data.frequency[_wave_loads(data)]):
        loads = np.nan_to_num(data.displacement[data.frequency == frequency]) * data.mask[:, None]
        waves = [grid.box(component) for u in loads for component in u.T]
        k, energy = _local_wave_number(grid, waves)
        slowness += energy * (k / (2 * np.pi * frequency)) ** 2
        total += energy
    with np.errstate(divide="ignore", invalid="ignore"):
        G = grid.flat(data.density * total / slowness)
    return np.where(data.mask & np.isfinite(G), G, np.nan) + 0j


def _local_wave_number(grid: Grid, waves: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Local wave number (1/m) on the grid, and the energy behind it."""
    padded = [fft.next_fast_len(n + n // 2) for n in grid.shape]  # zeros keep what leaves on one side from coming back
    axes = [2 * np.pi * np.fft.fftfreq(n, h) for n, h in zip(padded, grid.spacing, strict=True)]
    K = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    size = np.linalg.norm(K, axis=-1)
    size[(0,) * len(padded)] = np.inf
    highest, lowest = np.pi / grid.spacing.max(), np.pi / (np.array(grid.shape) * grid.spacing).max()
    centres = highest / _OCTAVE ** np.arange(0.5, np.log2(highest / lowest) + 1)[::-1]
    turns = [np.maximum(K @ n / size, 0) ** 2 for n in _directions(len(padded))]
    spectra = [fft.fftn(wave, padded) for wave in waves]
    inside = tuple(slice(n) for n in grid.shape)
    answers = []
    for centre in centres:
        with np.errstate(divide="ignore"):
            radial = np.exp(-_STEEPNESS * np.log(size / centre) ** 2)
        answers.append(sum(np.abs(fft.ifftn(s * radial * turn)[inside]) ** 2 for s in spectra for turn in turns))
    k, energy = np.zeros(grid.shape), np.zeros(grid.shape)
    for low, high, first, second in zip(centres, centres[1:], answers, answers[1:], strict=False):
        energy += np.sqrt(first * second)
        k += np.sqrt(low * high) * second  # q_i q_{i+1} · q_{i+1}/q_i
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(k / energy), energy


def _directions(d: int) -> np.ndarray:
    """Evenly spread unit vectors: of a hexagon or an icosahedron."""
    if d == 2:
        turn = np.arange(6) * np.pi / 3
        return np.stack([np.cos(turn), np.sin(turn)], axis=1)
    golden = (1 + np.sqrt(5)) / 2
    corners = [np.roll([0, a, b * golden], i) for i in range(3) for a in (-1, 1) for b in (-1, 1)]
    return np.array(corners) / np.hypot(1, golden)


def _solve_pointwise(data: WaveData, columns: list[np.ndarray], u: np.ndarray, window: float) -> np.ndarray:
    """Moduli (p, n) with Σ_p columns_p · moduli_p = -ρω²u, all (loads, n, components), by least squares at each point."""
    moving = _wave_loads(data)
    omega = 2 * np.pi * data.frequency[moving]
    right = -data.density * omega[:, None, None] ** 2 * u[moving]
    left = np.stack([column[moving] for column in columns])
    known = np.isfinite(right) & np.isfinite(left).all(axis=0) & data.mask[None, :, None]
    left, right = np.where(known, left, 0), np.where(known, right, 0)
    normal = np.einsum("plnc,qlnc->npq", left.conj(), left)
    load = np.einsum("plnc,lnc->np", left.conj(), right)
    if window > 0:
        near = _neighbour_matrix(data.points, window)
        normal = (near @ normal.reshape(len(normal), -1)).reshape(normal.shape)
        load = near @ load
    if data.rheology == "elastic":
        normal, load = normal.real, load.real
    # Equilibrated: the columns may differ by the bulk modulus over the shear modulus.
    scale = np.sqrt(np.einsum("npp->np", normal).real)
    with np.errstate(divide="ignore", invalid="ignore"):
        even = normal / (scale[:, :, None] * scale[:, None, :])
    solvable = data.mask & np.isfinite(even).all(axis=(1, 2))
    solvable[solvable] = np.abs(np.linalg.det(even[solvable])) > 1e-12
    moduli = np.full((len(columns), len(normal)), np.nan, complex)
    even, load, scale = even[solvable], load[solvable], scale[solvable]
    moduli[:, solvable] = (np.linalg.solve(even, (load / scale)[:, :, None])[:, :, 0] / scale).T
    return moduli


def _wave_loads(data: WaveData) -> np.ndarray:
    """Which loads are waves."""
    moving = data.frequency > 0
    if not moving.any():
        raise InputError("frequency", "0 in every load", "a wave: quasi-static data have no ρω²u to compare with")
    return moving


def _neighbour_matrix(points: np.ndarray, radius: float) -> csr_array:
    """(n, n): 1 where two points are no farther apart than the radius."""
    i, j = KDTree(points).query_pairs(radius, output_type="ndarray").T
    own = np.arange(len(points))
    rows, columns = np.r_[i, j, own], np.r_[j, i, own]
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(points),) * 2)
