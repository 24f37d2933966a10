"""Slabs with motion through their slices alone: each slice by itself, as anti-plane shear.

A slab of a few slices is cut out of tissue. Its top and bottom are not free, and in space nearly all of its displacements
would be boundary unknowns. Where the wave travels within the slices, each of them is a complete problem. Where it does not,
moduli are too large by the factor ∇²u/(∂²u/∂x² + ∂²u/∂y²), which three slices or more determine.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.inverse.data.quality import OctahedralShearStrain, noise_deviation, rms_noise
from ngbrain.inverse.elastography.result import Inversion, StartResult
from ngbrain.inverse.elastography.usability import PATCHES
from ngbrain.inverse.optimise.result import convergence_status
from ngbrain.io.waves import WaveData
from ngbrain.progress import LOG

Array = np.ndarray
FEWEST = 90
"""Fewest points of a slice: smooth fields need as many."""
WINDOW = 5
"""Most slices to which a parabola is fitted."""


def moving_axis(data: WaveData) -> int | None:
    """Return the axis along which alone the waves of a grid in space move, as far as they were measured; None for several
    components.

    A component that is exactly 0 everywhere counts as not measured: no scan has that.

    Examples
    --------
    >>> line = np.arange(5) * 2e-3
    >>> grid = np.array([[x, y, z] for z in line for y in line for x in line])
    >>> u = np.zeros((1, 125, 3)); u[:, :, 2] = 1e-6
    >>> data = WaveData(grid, u, [50.0], 1000.0, "isotropic", "viscoelastic", bulk=2e9)
    >>> moving_axis(data)
    2
    """
    grid = data.grid
    if (
        data.dim != 3
        or grid is None
        or not grid.is_axis_aligned
        or data.symmetry != "isotropic"
        or not np.all(data.frequency)
    ):
        return None
    moves = np.any(np.nan_to_num(data.displacement[:, data.mask]) != 0, axis=(0, 1))
    return int(moves.argmax()) if moves.sum() == 1 else None


def slices_of(data: WaveData, axis: int) -> list[tuple[Array, WaveData]]:
    """Return the slices across an axis.

    Parameters
    ----------
    data : WaveData
        A slab on a grid.
    axis : int
        The axis of motion.

    Returns
    -------
    list of (numpy.ndarray, WaveData)
        Indices of the points of a slice, and its anti-plane waves. Slices of fewer than `FEWEST` points are left out.

    Raises
    ------
    InputError
        No slice has enough points.
    """
    grid = data.grid
    assert grid is not None
    numbers, other = grid.box(np.arange(len(data.points))), [i for i in range(3) if i != axis]
    default = np.array_equal(data.dirichlet, data.border)
    found = []
    for k in range(grid.shape[axis]):
        own = numbers.take(k, axis=axis).ravel(order="F")
        moved = data.displacement[:, own][:, :, [axis]]
        if (np.isfinite(moved).any(axis=(0, 2)) & data.mask[own]).sum() < FEWEST:
            continue
        one = WaveData(
            data.points[own][:, other],
            moved,
            data.frequency,
            data.density,
            data.symmetry,
            data.rheology,
            poisson=data.poisson,
            bulk=data.bulk,
            mask=data.mask[own],
            noise=data.noise[own] if isinstance(data.noise, np.ndarray) else data.noise,
            labels=None if data.labels is None else data.labels[own],
            truth={name: values[own] for name, values in data.truth.items()},
            motion="anti_plane",
            tissue=data.tissue,
        )
        found.append((own, one if default else replace(one, dirichlet=one.border & data.dirichlet[own])))
    if not found:
        raise InputError("mask", "of a few points of each slice", f"{FEWEST} of one or more")
    return found


def _invert_slice(invert: Callable[..., Inversion], one: WaveData, *, callback: parallel.Callback) -> Inversion:
    """Without the final state, which belongs to one process."""
    return replace(invert(one, callback=callback), final_state=None)


def invert_slices(
    data: WaveData,
    axis: int,
    invert: Callable[..., Inversion],
    executor: parallel.AnyExecutor = None,
    callback: parallel.Callback | None = None,
) -> Inversion:
    """Invert a slab slice by slice.

    Parameters
    ----------
    data : WaveData
        A slab on a grid.
    axis : int
        The axis of motion.
    invert : callable
        Inverts a slice; is called with it and `callback`.
    executor : int or executor, optional
        Runs the slices, each on one thread (`parallel.run`). The result does not depend on it.
    callback : callable, optional
        Is called with each `Iteration`.

    Returns
    -------
    Inversion
        Maps of the slab. Its one start, `slices`, has the sums over all slices. It has no `final_state` for error bars.
    """
    unmeasured = [i for i in range(3) if i != axis]
    u = data.displacement.copy()
    u[:, :, unmeasured] = np.nan
    parts = slices_of(data, axis)
    tasks = [
        parallel.Task(f"slice {number} of {len(parts)}", _invert_slice, (invert, one))
        for number, (_, one) in enumerate(parts, 1)
    ]
    each: list[Inversion] = list(
        parallel.run(
            tasks, executor, callback=callback, finished=lambda name, _: LOG.info("%s is inverted", name)
        ).values()
    )
    for (own, _), found in zip(parts, each, strict=True):
        u[:, own, axis] = found.data.displacement[:, :, 0]  # outliers removed
    data, whole = replace(data, displacement=u), [own for own, _ in parts]
    n, first, ends = len(data.points), each[0], [found.starts[-1] for found in each]
    noise = np.ones(n)
    for own, found in zip(whole, each, strict=True):
        # Relative to the slab's rms, not the slice's.
        share = float(np.mean(found.data.rms / data.rms[:, :, [axis]]))
        noise[own] = share * np.broadcast_to(np.asarray(found.noise), len(own))
    oss, snr = (_join_slices([getattr(found.strain, name) for found in each], whole, n) for name in ("oss", "snr"))
    strain = OctahedralShearStrain(oss, snr)
    predicted = np.full(data.displacement.shape, np.nan, complex)
    for own, found in zip(whole, each, strict=True):
        predicted[:, own, axis] = found.predicted[:, :, 0]
    maps = {name: _join_slices([found.maps[name] for found in each], whole, n) for name in first.maps}
    row = StartResult(
        "slices",
        maps,
        sum(end.misfit for end in ends),
        sum(end.expected for end in ends),
        sum(end.value for end in ends),
        [entry for found in each for entry in found.starts[-1].history],
        sum(end.cpu_s for end in ends),
        all(end.converged for end in ends),
    )
    exponents = [found.checks["exponent"] for found in each if "exponent" in found.checks]
    left = noise_deviation(data, noise)[:, :, axis]
    off = (data.displacement[:, :, axis] - predicted[:, :, axis]) / left
    known = data.mask & np.isfinite(off).all(axis=0)
    explained = float(np.sqrt(np.mean(np.abs(off[:, known]) ** 2 / 2))) * rms_noise(data, noise)
    through = share_through(data, axis, maps)
    checks: dict[str, float | bool | None] = {
        "misfit_over_expected": row.misfit / row.expected,
        "converged": row.converged,
        "strain_snr": strain.median,
        "share_through_slices": through,
        "exponent": float(np.median(exponents)) if exponents else None,
        PATCHES: max((found.checks.get(PATCHES, 0.0) for found in each), default=0.0) or None,
    }
    names = ("determined", "weights", "resolution")
    joined = {name: [getattr(found, name) for found in each] for name in names}
    return Inversion(
        data=data,
        maps=maps,
        predicted=predicted,
        starts=[row],
        chosen=row.name,
        noise=noise,
        noise_found=explained,
        regulariser=first.regulariser,
        weights={name: float(np.median([w[name] for w in joined["weights"]])) for name in first.weights},
        determined={name: float(sum(d[name] for d in joined["determined"])) for name in first.determined},
        resolution={name: float(np.median([r[name] for r in joined["resolution"]])) for name in first.resolution},
        solves=Solves.sum(found.solves for found in each),
        history=row.history,
        model={
            **first.model,
            "n_elements": sum(found.model["n_elements"] for found in each),
            "n_parameters": sum(found.model["n_parameters"] for found in each),
            "inverse_crime": any(found.model["inverse_crime"] for found in each),
            "slices": len(each),
        },
        checks={name: value for name, value in checks.items() if value is not None},
        strain=strain,
        stated=float(np.sqrt(np.mean([found.stated**2 for found in each]))),
        warnings=[_slices_note(axis, len(each), through), *_merge_notes([found.warnings for found in each])],
        status=convergence_status(row.converged),
    )


def share_through(data: WaveData, axis: int, maps: dict[str, Array]) -> float | None:
    """Return the share of ∂²u/∂z² in ∇²u, with z across the slices.

    It comes from parabolas through up to `WINDOW` slices. Their curvature and their mean have independent errors, so that
    noise has no bias.

    Parameters
    ----------
    data : WaveData
        A slab on a grid.
    axis : int
        z.
    maps : dict of str to numpy.ndarray
        Property → (n,) Pa, from which the rest of ∇²u follows.

    Returns
    -------
    float or None
        The share; None for fewer than three slices.
    """
    grid = data.grid
    assert grid is not None
    size, spacing = min(WINDOW, grid.shape[axis]), grid.spacing[axis]
    if size < 3:
        return None
    basis, triangle = np.linalg.qr(np.vander(spacing * np.arange(size), 3, increasing=True))
    u = np.where(data.mask, data.displacement[:, :, axis], np.nan)
    columns = np.moveaxis(grid.box(u.T), axis, -1)  # (a, b, loads, slices)
    windows = np.lib.stride_tricks.sliding_window_view(columns, size, axis=-1) @ basis
    mean, bend = windows[..., 0] * triangle[0, 0] / size, 2 * windows[..., 2] / triangle[2, 2]
    shear = maps["storage"] + 1j * maps["loss"] if "storage" in maps else data.shear_of(maps["youngs"]) + 0j
    along = (
        data.density * (2 * np.pi * data.frequency) ** 2 * np.median((1 / shear[data.mask & np.isfinite(shear)]).real)
    )
    known = np.isfinite(mean) & np.isfinite(bend)
    through = [
        -float(np.sum((np.conj(m) * b)[k]).real) / max(float(np.sum(np.abs(m[k]) ** 2)), 1e-300)
        for m, b, k in ((mean[:, :, i], bend[:, :, i], known[:, :, i]) for i in range(data.loads))
    ]
    if not known.any():
        return None
    return float(np.mean([max(t, 0.0) / (max(t, 0.0) + a) for t, a in zip(through, along, strict=True)]))


def _join_slices(values: list[Array], whole: list[Array], n: int) -> Array:
    """(…, n) from (…, points of a slice) each; NaN where there is no slice."""
    joined = np.full((*values[0].shape[:-1], n), np.nan)
    for own, each in zip(whole, values, strict=True):
        joined[..., own] = each
    return joined


def _slices_note(axis: int, number: int, through: float | None) -> str:
    words = (
        f"only motion along {'xyz'[axis]} was measured (other components are 0 or missing): {number} slices are inverted one by "
        "one as anti-plane shear, which takes tissue and waves as the same through them"
    )
    if through is None:
        return f"{words}; three slices or more would show how far that is so"
    share = f"the second derivative through the slices is {100 * through:.2g} % of the Laplacian"
    return f"{words}; {share}, by which moduli are too large"


def _merge_notes(notes: list[list[str]]) -> list[str]:
    """Notes of all slices. Of notes that differ in numbers alone, the first one, with the number of slices that have it."""
    alike: dict[str, list[str]] = {}
    for own in notes:
        for note in own:
            alike.setdefault(re.sub(r"\d[\d.e+-]*", "#", note), []).append(note)
    every = len(notes)
    return [
        same[0] if len(same) == every and len(set(same)) == 1 else f"{same[0]} (a slice; {len(same)} of {every} alike)"
        for same in alike.values()
    ]
