"""The page of an inversion of wave data: waves and their fit, maps with the truth where it is known, tables."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.inverse.elastography.derived_maps import DERIVED, scale_to_truth
from ngbrain.inverse.problem.discretisation import has_unknown_scale
from ngbrain.io.waves import WaveData
from ngbrain.report.pages import parameters
from ngbrain.report.pages.page import write_page
from ngbrain.report.pages.parameters import PARAMETERS
from ngbrain.report.pictures.panel import Panel
from ngbrain.report.pictures.plane_table import draw_table, window
from ngbrain.report.pictures.planes import Plane, planes
from ngbrain.report.pictures.planes import panel as planes_panel
from ngbrain.report.pictures.style import SPARE, figure, png, style
from ngbrain.report.render.surface import Floats

MOST_LOADS = 6
"""Largest number of loads that are drawn, from the first on."""
WAVE, MODULUS, DIFFERENCE = "RdBu_r", "viridis", "PuOr_r"
FAINT = 0.1
"""Imaginary parts below this part of the whole, as of undamped waves, are not drawn."""
SIGMAS = 4.0
"""Range of the residuals drawn, in standard deviations to each side."""


def build(
    path: str | os.PathLike[str], result: Mapping[str, Any], data: WaveData, arrays: Mapping[str, Floats]
) -> Path:
    """Write the page of an inversion.

    Parameters
    ----------
    path : str or path-like
        Output file.
    result : mapping of str to Any
        Result of the command `invert`.
    data : WaveData
        The wave data.
    arrays : mapping of str to ndarray
        Content of maps.npz: values at the points of the data, with NAME_low and NAME_high where there are error bars.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is not installed.
    """
    flat = planes(data)
    loads = min(data.loads, MOST_LOADS)
    pictures = {f"waves_{load}": waves(data, arrays, load, flat) for load in range(loads)}
    pictures |= {
        "maps": maps(result, data, arrays, flat),
        "derived": derived_maps(arrays, flat),
        "intervals": intervals(result, arrays, flat),
        "strain": strain(data, arrays, flat),
        "residuals": residuals(result, arrays["residual"]),
        "convergence": convergence(result),
    }
    return write_page(
        Path(path),
        "elastography.html",
        pictures,
        panel=panel(result, data, arrays),
        result=result,
        waves=[(f"waves_{load}", load_name(data, load)) for load in range(loads)],
        loads=data.loads,
        space=data.dim == 3,
        symbols=[PARAMETERS[name].symbol for name in result["answers"]],
        parameters=parameters.parameters(result),
        intervals=parameters.intervals(result),
        label_heads=parameters.label_heads(result),
        labels=parameters.labels(result),
        starts=parameters.starts(result),
        facts=[*data_facts(data), *parameters.facts(result)],
        known=any("relative_l2_error" in answer for answer in result["answers"].values()),
    )


def panel(result: Mapping[str, Any], data: WaveData, arrays: Mapping[str, Floats]) -> Panel | None:
    """Maps of the parameters, of what is derived from them and of their intervals, and the truth, to be turned.

    Parameters
    ----------
    result : mapping of str to Any
        Result of the command `invert` or `predict`.
    data : WaveData
        The wave data.
    arrays : mapping of str to ndarray
        The maps.

    Returns
    -------
    Panel or None
    """
    found: dict[str, tuple[Floats, Floats]] = {}

    def add(name: str, values: Floats, look: Mapping[str, Any] | None = None) -> None:
        look = look or window(MODULUS, values)
        found[name] = values, np.array([look["vmin"], look["vmax"]])

    truths = data.truth_views
    for name in result["answers"]:
        values = PARAMETERS[name].factor * scale_to_truth(data, name, arrays[name])
        truth = (
            np.where(data.mask, PARAMETERS[name].factor * np.real(truths[name]), np.nan) if name in truths else values
        )
        look = window(MODULUS, np.concatenate([values, truth]))
        add(PARAMETERS[name].label, values, look)
        if name in truths:
            add(f"{PARAMETERS[name].label}, truth", truth, look)
        if f"{name}_low" in arrays:
            width = 50 * (arrays[f"{name}_high"] - arrays[f"{name}_low"]) / np.abs(arrays[name])
            add(f"{PARAMETERS[name].symbol}, half width of the 95 % interval (%)", width)
    for name in DERIVED:
        if name in arrays and np.nanmax(np.abs(arrays[name])) > 0:
            add(PARAMETERS[name].label, PARAMETERS[name].factor * arrays[name])
    if "oss_snr" in arrays and np.isfinite(arrays["oss_snr"][0]).any():
        add(PARAMETERS["oss_snr"].label, arrays["oss_snr"][0])
    return planes_panel(data, found, MODULUS)


def waves(data: WaveData, arrays: Mapping[str, Floats], load: int, flat: Sequence[Plane]) -> bytes:
    """Measured wave, fit and residual of every component of a load: real parts, and imaginary parts of plane data if they matter.

    Parameters
    ----------
    data : WaveData
        The wave data.
    arrays : mapping of str to ndarray
        Fitted waves and residuals.
    load : int
        Number of the load.
    flat : sequence of Plane
        Planes to draw.

    Returns
    -------
    bytes
        A PNG.
    """
    measured, predicted, residual = (arrays[name][load] for name in ("measured", "predicted", "residual"))
    rows = []
    for i, axis in enumerate(data.components):
        if np.isnan(measured[:, i]).all():
            continue
        for part, take in (("Re", np.real), ("Im", np.imag)):
            values = take(measured[:, i])
            if part == "Re" or (data.dim == 2 and _rms(values) > FAINT * _rms(measured[:, i])):
                name = f"{part} $u_{axis}$ (µm)"
                rows += [
                    (name, plane, 1e6 * values, 1e6 * take(predicted[:, i]), take(residual[:, i])) for plane in flat
                ]
    titles = ("measured", "fitted", "residual / noise")

    def looks(row: int) -> list[tuple[dict[str, Any], Floats]]:
        name, _, values, fitted, left = rows[row]
        same = [each[2] for each in rows if each[0] == name]  # one colour scale for all planes
        top = max(float(np.nanmax(np.abs(each))) for each in same)
        wave = {"cmap": WAVE, "vmin": -top, "vmax": top}
        return [(wave, values), (wave, fitted), ({"cmap": WAVE, "vmin": -SIGMAS, "vmax": SIGMAS}, left)]

    return draw_table([plane for _, plane, *_ in rows], titles, [name for name, *_ in rows], looks)


def maps(result: Mapping[str, Any], data: WaveData, arrays: Mapping[str, Floats], flat: Sequence[Plane]) -> bytes:
    """Maps of each parameter: the estimate and, where known, the truth in the same colours and the difference in per cent.

    Parameters
    ----------
    result : mapping of str to Any
        Result of the command `invert`.
    data : WaveData
        The wave data.
    arrays : mapping of str to ndarray
        The maps.
    flat : sequence of Plane
        Planes to draw.

    Returns
    -------
    bytes
        A PNG.
    """
    truths = data.truth_views
    names = list(result["answers"])
    rows = [(name, plane) for name in names for plane in flat]
    known = any(name in truths for name in names)
    first = "estimate, at the truth's level" if has_unknown_scale(data) else "estimate"
    titles = (first, "truth", "difference (%)") if known else ("estimate",)

    def looks(row: int) -> list[tuple[dict[str, Any], Floats]]:
        name = rows[row][0]
        factor = PARAMETERS[name].factor
        estimate = factor * scale_to_truth(data, name, arrays[name])
        if name not in truths:
            return [(window(MODULUS, estimate), estimate)]
        truth = np.where(data.mask, factor * np.real(truths[name]), np.nan)
        off = 100 * (estimate - truth) / np.nanmedian(np.abs(truth))
        most = max(float(np.nanpercentile(np.abs(off), 98)), 1e-6)
        both = window(MODULUS, np.concatenate([estimate, truth]))
        return [(both, estimate), (both, truth), ({"cmap": DIFFERENCE, "vmin": -most, "vmax": most}, off)]

    return draw_table([plane for _, plane in rows], titles, [PARAMETERS[name].label for name, _ in rows], looks)


def intervals(result: Mapping[str, Any], arrays: Mapping[str, Floats], flat: Sequence[Plane]) -> bytes:
    """Credible intervals of each parameter with error bars: both ends in the same colours, and half the width in per cent.

    Parameters
    ----------
    result : mapping of str to Any
        Result of the command `invert`.
    arrays : mapping of str to ndarray
        The maps.
    flat : sequence of Plane
        Planes to draw.

    Returns
    -------
    bytes
        A PNG.
    """
    rows = [(name, plane) for name in result["answers"] if f"{name}_low" in arrays for plane in flat]
    if not rows:
        return b""

    def looks(row: int) -> list[tuple[dict[str, Any], Floats]]:
        name = rows[row][0]
        low, high = (PARAMETERS[name].factor * arrays[f"{name}_{end}"] for end in ("low", "high"))
        width = 50 * (high - low) / np.abs(PARAMETERS[name].factor * arrays[name])
        both = window(MODULUS, np.concatenate([low, high]))
        return [(both, low), (both, high), (window(MODULUS, width), width)]

    titles = ("2.5 % end", "97.5 % end", "half width (%)")
    return draw_table([plane for _, plane in rows], titles, [PARAMETERS[name].label for name, _ in rows], looks)


def derived_maps(arrays: Mapping[str, Floats], flat: Sequence[Plane]) -> bytes:
    """Maps of the quantities derived from the complex shear modulus.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        The maps.
    flat : sequence of Plane
        Planes to draw.

    Returns
    -------
    bytes
        A PNG.
    """
    names = [name for name in DERIVED if np.nanmax(np.abs(arrays[name])) > 0]
    titles = [PARAMETERS[name].label for name in names]

    def looks(row: int) -> list[tuple[dict[str, Any], Floats]]:
        return [
            (window(MODULUS, values), values) for values in (PARAMETERS[name].factor * arrays[name] for name in names)
        ]

    return draw_table(flat, titles, [""] * len(flat), looks)


def strain(data: WaveData, arrays: Mapping[str, Floats], flat: Sequence[Plane]) -> bytes:
    """Octahedral shear strain of each completely measured load, and its ratio to noise.

    Parameters
    ----------
    data : WaveData
        The wave data.
    arrays : mapping of str to ndarray
        The maps.
    flat : sequence of Plane
        Planes to draw.

    Returns
    -------
    bytes
        A PNG; empty without such a load.
    """
    names, loads = ("oss", "oss_snr"), min(data.loads, MOST_LOADS)
    rows = [(load, plane) for load in range(loads) if np.isfinite(arrays["oss"][load]).any() for plane in flat]

    def looks(row: int) -> list[tuple[dict[str, Any], Floats]]:
        shown = [PARAMETERS[name].factor * arrays[name][rows[row][0]] for name in names]
        return [(window(MODULUS, values), values) for values in shown]

    if not rows:
        return b""
    titles = [PARAMETERS[name].label for name in names]
    return draw_table([plane for _, plane in rows], titles, [load_name(data, load) for load, _ in rows], looks)


def residuals(result: Mapping[str, Any], residual: Floats) -> bytes:
    """Histogram of the normalised residuals against the normal distribution of a good fit.

    Parameters
    ----------
    result : mapping of str to Any
        Result of the command `invert`.
    residual : ndarray
        Residuals in standard deviations of the noise.

    Returns
    -------
    bytes
        A PNG.
    """
    left = np.concatenate([residual.real.ravel(), residual.imag.ravel()])
    left = left[np.isfinite(left)]
    used = 1 - result["starts"][result["selected_start"]]["expected_misfit"] / left.size
    width = np.sqrt(max(1 - used, 1e-6))
    with style():
        page = figure(2.9)
        axes = page.add_axes((0.075, 0.17, 0.55, 0.74))
        axes.hist(np.clip(left, -5, 5), np.linspace(-5, 5, 81), density=True, color="#9db3c4", label="residuals")
        at = np.linspace(-5, 5, 301)
        for spread, dash, label in (
            (1.0, ":", "noise"),
            (width, "-", "noise, with the fitted degrees of freedom removed"),
        ):
            density = np.exp(-((at / spread) ** 2) / 2) / (spread * np.sqrt(2 * np.pi))
            axes.plot(at, density, color="#B2182B", ls=dash, lw=1.4, label=label)
        axes.set(xlabel="(measured − fitted) / noise, real and imaginary parts", ylabel="density", xlim=(-5, 5))
        axes.legend(frameon=False, fontsize=8.5, loc="upper left")
        lines = [
            f"{left.size} numbers",
            f"mean {left.mean():+.3f}".replace("-", "−"),
            f"standard deviation {left.std():.3f}, expected {width:.3f}",
            f"beyond ±3: {100 * float(np.mean(np.abs(left) > 3)):.2f} % (noise: 0.27 %)",
            "Values beyond ±5 are counted in the end bins.",
        ]
        page.text(0.655, 0.86, "\n".join(lines), va="top", fontsize=9)
        return png(page)


def convergence(result: Mapping[str, Any]) -> bytes:
    """Misfit over its expected value, and regularisation weights, by iteration of each initial guess, as a PNG."""
    starts, named = result["starts"], result["model"].get("fields")
    styles: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (5, 1)), (0, (1, 1)), (0, (3, 1, 1, 1)), (0, (8, 2)))
    with style():
        page = figure(2.9)
        left, right = page.add_axes((0.075, 0.17, 0.37, 0.72)), page.add_axes((0.55, 0.17, 0.37, 0.72))
        for (name, start), colour in zip(starts.items(), SPARE, strict=False):
            rounds = np.arange(1, len(start["misfit_over_expected"]) + 1)
            label = parameters.STARTS[name]
            left.plot(rounds, start["misfit_over_expected"], color=colour, marker="o", ms=3, lw=1.3, label=label)
            for field, dash in zip(start["weights"][0] if start["weights"] else (), styles, strict=False):
                values = [weights[field] for weights in start["weights"]]
                right.plot(rounds, values, color=colour, ls=dash, marker="o", ms=2.5, lw=1.2)
        left.axhline(1, color="#555555", lw=0.8)
        left.set(xlabel="iteration", yscale="log", title="misfit over its expected value")
        right.set(xlabel="iteration", yscale="log", title="regularisation weights")
        left.legend(frameon=False, fontsize=8.5)
        fields = next((list(s["weights"][0]) for s in starts.values() if s["weights"]), [])
        for field, dash in zip(fields, styles, strict=False):
            right.plot([], [], color="#555555", ls=dash, label=parameters.symbol(field, named))
        right.legend(frameon=False, fontsize=8.5)
        for axes in (left, right):
            axes.xaxis.get_major_locator().set_params(integer=True)
        return png(page)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.nanmean(np.abs(values) ** 2)))


def load_name(data: WaveData, load: int) -> str:
    """Name of a load.

    Parameters
    ----------
    data : WaveData
        The wave data.
    load : int
        Number of the load.

    Returns
    -------
    str
        The name.
    """
    frequency = data.frequency[load]
    return f"Load {load + 1}, " + (f"{frequency:g} Hz" if frequency else "quasi-static")


def data_facts(data: WaveData) -> list[tuple[str, str]]:
    """Facts about the data and the material model: pairs of name and text."""
    grid = data.grid
    form = "grid of " + " × ".join(map(str, grid.shape)) if grid else "scattered"
    where = f"{len(data.points)} points, {form}; {int(data.mask.sum())} of them in the mask"
    if data.bulk is not None:
        held = f"bulk modulus fixed at {data.bulk / 1e3:.4g} kPa"
    elif data.poisson is not None:
        held = f"Poisson's ratio fixed at {data.poisson:g}"
    else:
        held = "out-of-plane motion, incompressible"
    fibres = ", fibres given" if data.symmetry == "transversely_isotropic" else ""
    material = f"{data.symmetry.replace('_', ' ')}, {data.rheology}{fibres}; {held}; {data.density:g} kg/m³"
    return [("Data", f"{where}; {data.loads} load{'s' if data.loads > 1 else ''}"), ("Material", material)]
