"""Maps derived from G*, statistics by label, and errors against the truth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ngbrain.errors import InputError, nearest
from ngbrain.inverse.problem.discretisation import has_unknown_scale
from ngbrain.io.waves.data import WaveData

PARAMETERS = ("youngs", "storage", "loss", "mu", "zeta", "phi")
DERIVED = ("magnitude", "phase", "damping_ratio", "stiffness")
"""Maps of `maps_from_shear` beside the parameters."""
RATIOS = ("zeta", "phi")


def maps_from_shear(shear: np.ndarray) -> dict[str, np.ndarray]:
    """Return maps that follow from a complex shear modulus G* = G' + iG''.

    Parameters
    ----------
    shear : numpy.ndarray
        (n,) G*, Pa.

    Returns
    -------
    dict of str to numpy.ndarray
        storage: G' = Re G*, Pa; loss: G'' = Im G*, Pa; magnitude: |G*|, Pa; phase: arg G*, rad; damping_ratio: ξ = G''/2G';
        stiffness: 2|G*|²/(G' + |G*|), Pa, which is ρ times the squared speed of a plane shear wave.

    Examples
    --------
    >>> maps = maps_from_shear(np.array([2000 + 800j]))
    >>> round(float(maps["stiffness"][0])), float(maps["damping_ratio"][0])
    (2234, 0.2)
    """
    shear = np.asarray(shear, complex)
    storage, loss, size = shear.real, shear.imag, np.abs(shear)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            "storage": storage,
            "loss": loss,
            "magnitude": size,
            "phase": np.angle(shear),
            "damping_ratio": loss / (2 * storage),
            "stiffness": 2 * size**2 / (storage + size),
        }


def shear_modulus_map(data: WaveData, maps: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the shear modulus of an inversion's maps.

    Parameters
    ----------
    data : WaveData
        The data.
    maps : mapping of str to numpy.ndarray
        Parameter → (n,)

    Returns
    -------
    numpy.ndarray
        (n,) G*, Pa; real for elastic data; μ where there are fibres.
    """
    if "storage" in maps:
        return maps["storage"] + 1j * maps["loss"]
    return np.real(maps["mu"] if "mu" in maps else data.shear_of(maps["youngs"]))


def median_shear(data: WaveData, maps: Mapping[str, np.ndarray]) -> float:
    """Return the median of |G*|.

    Parameters
    ----------
    data : WaveData
        The data.
    maps : mapping of str to numpy.ndarray
        Parameter → (n,)

    Returns
    -------
    float
        Pa
    """
    return float(np.nanmedian(np.abs(shear_modulus_map(data, maps))))


def median_and_iqr(values: np.ndarray) -> dict[str, float]:
    """Return `median` and `iqr` (third minus first quartile) of the finite values; empty if there is none.

    Examples
    --------
    >>> median_and_iqr(np.array([1.0, 2.0, 3.0, np.nan]))
    {'median': 2.0, 'iqr': 1.0}
    """
    values = values[np.isfinite(values)]
    if not values.size:
        return {}
    low, median, high = np.quantile(values, [0.25, 0.5, 0.75])
    return {"median": float(median), "iqr": float(high - low)}


def statistics_by_label(values: np.ndarray, labels: np.ndarray) -> dict[int, dict[str, float]]:
    """Return `median_and_iqr` for each label.

    Parameters
    ----------
    values : numpy.ndarray
        (n,) real values.
    labels : numpy.ndarray
        (n,) labels. 0 is a label like others. Labels without a finite value are left out.

    Returns
    -------
    dict of int to dict
        Label → `median` and `iqr`.

    Examples
    --------
    >>> statistics_by_label(np.array([1.0, 2.0, 4.0, np.nan]), np.array([0, 0, 2, 3]))
    {0: {'median': 1.5, 'iqr': 0.5}, 2: {'median': 4.0, 'iqr': 0.0}}
    """
    found = {int(label): median_and_iqr(values[labels == label]) for label in np.unique(labels)}
    return {label: each for label, each in found.items() if each}


def relative_l2_error(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Return ‖estimate - truth‖₂ / ‖truth‖₂ over the points.

    Parameters
    ----------
    estimate, truth : numpy.ndarray
        (n,)

    Returns
    -------
    float
        Infinite if the estimate is NaN at a point, or the truth is 0.

    Examples
    --------
    >>> relative_l2_error(np.array([3.0, 5.0]), np.array([3.0, 4.0]))
    0.2
    """
    off, size = float(np.linalg.norm(estimate - truth)), float(np.linalg.norm(truth))
    return off / size if np.isfinite(off) and size > 0 else float("inf")


def map_statistics(data: WaveData, found: Mapping[str, np.ndarray]) -> dict[str, dict[str, float]]:
    """Return the `answers` of `result.json`: for each parameter `median`, `iqr` and, with a truth, `relative_l2_error`.

    The error is left out where it is not finite: the truth is 0 everywhere, or the map is missing at a point. It is that of
    the map after `scale_to_truth`.

    Parameters
    ----------
    data : WaveData
        Its mask says which points count, its truth (`WaveData.truth_views`) what is right.
    found : mapping of str to numpy.ndarray
        Parameter (youngs, storage, loss, mu (Pa), zeta, phi) → real map (n,).

    Returns
    -------
    dict of str to dict
        Parameter → statistics.

    Raises
    ------
    InputError
        A parameter has another name, or a map is complex or of another shape.

    Examples
    --------
    >>> points = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> u, G = 1e-6 * np.ones((1, 9, 2)), np.full(9, 2000 + 800j)
    >>> data = WaveData(points, u, [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4, truth={"shear": G})
    >>> map_statistics(data, {"storage": 1.1 * G.real})
    {'storage': {'median': 2200.0, 'iqr': 0.0, 'relative_l2_error': 0.1}}
    """
    truths, given = data.truth_views, {}
    for name, values in found.items():
        if name not in PARAMETERS:
            raise InputError("parameter", repr(name), nearest(name, PARAMETERS))
        if np.shape(values) != (len(data.points),) or np.iscomplexobj(values):
            kind = f"{np.asarray(values).dtype} of shape {np.shape(values)}"
            raise InputError(name, kind, f"a real map of shape ({len(data.points)},)")
        given[name] = median_and_iqr(values[data.mask])
        if name in truths and np.any(truths[name][data.mask]):
            there = scale_to_truth(data, name, values)
            error = relative_l2_error(there[data.mask], truths[name][data.mask].real)
            if np.isfinite(error):
                given[name]["relative_l2_error"] = error
    return given


def scale_to_truth(data: WaveData, name: str, values: np.ndarray) -> np.ndarray:
    """Scale a map of moduli to the truth where their common factor is unknown (`has_unknown_scale`).

    Parameters
    ----------
    data : WaveData
        Data with a truth.
    name : str
        Parameter.
    values : numpy.ndarray
        (n,) map.

    Returns
    -------
    numpy.ndarray
        (n,) the map, times the least-squares factor to the truth; unchanged for other data.

    Examples
    --------
    >>> points = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> still = WaveData(points, np.full((1, 9, 2), 1e-6), [0.0], 1e3, "isotropic", "elastic", 0.4, truth={"shear": np.ones(9)})
    >>> round(float(scale_to_truth(still, "youngs", np.full(9, 7.0))[0]), 9)  # 2 G (1 + ν)
    2.8
    """
    if name in RATIOS or name not in data.truth_views or not has_unknown_scale(data):
        return values
    known = data.mask & np.isfinite(values)
    truth = np.real(data.truth_views[name][known])
    return values * float(truth @ values[known] / (values[known] @ values[known]))


def parameters_from_shear(data: WaveData, shear: np.ndarray) -> dict[str, np.ndarray]:
    """Return the parameters of isotropic data from a complex shear modulus: storage and loss, or youngs.

    Young's modulus is E = 2G(1 + ν), or 9KG/(3K + G) where the bulk modulus K is given.

    Parameters
    ----------
    data : WaveData
        Isotropic data.
    shear : numpy.ndarray
        (n,) G*, Pa.

    Returns
    -------
    dict of str to numpy.ndarray
        Parameter → (n,) Pa.

    Raises
    ------
    InputError
        The data are transversely isotropic.
    """
    if data.symmetry != "isotropic":
        raise InputError("symmetry", data.symmetry, "isotropic: one shear modulus says it all")
    if data.rheology == "viscoelastic":
        return {"storage": shear.real, "loss": shear.imag}
    return {"youngs": data.youngs_of(shear).real}
