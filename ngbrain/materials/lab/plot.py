"""Plots of the material laboratory."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ngbrain.errors import InputError, require
from ngbrain.look import STYLE, figure
from ngbrain.materials.base import Law
from ngbrain.materials.catalogue import Published, find_entry
from ngbrain.materials.families import instantaneous_law
from ngbrain.materials.lab.curves import Curve
from ngbrain.materials.lab.description import describe_law
from ngbrain.materials.lab.elastic import stress
from ngbrain.materials.lab.modes import MODES, find_mode
from ngbrain.materials.maxwell import Maxwell
from ngbrain.materials.viscous import Branch, Viscous, viscous

LINES = (
    ("#0072B2", "-"), ("#D55E00", (0, (5, 1.6))), ("#009E73", (0, (6, 1.4, 1.4, 1.4))), ("#CC79A7", (0, (1.5, 1.5))),
    ("#8C6D00", (0, (8, 2))), ("#56B4E9", "-"),
)  # fmt: skip
MARKS = "osD^v"
RANGES = {"uniaxial": (0.8, 1.25), "equibiaxial": (0.85, 1.15), "planar": (0.8, 1.25), "shear": (-0.4, 0.4)}
SAMPLES = 121


def plot(laws: Mapping[str, Law], data: Iterable[Curve] = (), modes: Sequence[str] | None = None) -> Any:
    """Plot nominal stress (kPa) against stretch, one panel per mode: laws as lines, data as markers.

    Parameters
    ----------
    laws : dict of str to Law
        Label → elastic law.
    data : iterable of Curve, optional
        Elastic curves; they set the modes and the ranges.
    modes : sequence of str, optional
        Modes to show; without them those of the data, or all four.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        Nothing to plot, or more laws than line styles.
    """
    curves = list(data)
    if not laws and not curves:
        raise InputError("laws", "empty", "at least one law or one curve")
    if len(laws) > len(LINES):
        raise InputError("laws", f"{len(laws)} laws", f"at most {len(LINES)}, so that lines stay distinguishable")
    shown = [find_mode(m).name for m in modes or [m for m in MODES if not curves or m in {c.mode for c in curves}]]

    with require("matplotlib", "report").rc_context(STYLE):
        page = figure(max(4.5, 3.6 * len(shown)), 3.9)
        panels = page.subplots(1, len(shown), squeeze=False)[0]
        marked = list(zip(curves, MARKS * (len(curves) // len(MARKS) + 1), strict=False))
        for axes, mode in zip(panels, shown, strict=True):
            _panel(axes, mode, laws, [(curve, mark) for curve, mark in marked if curve.mode == mode])
        panels[0].set_ylabel("nominal stress (kPa)")
        entries: dict[str, Any] = {}
        for axes in panels:
            entries |= {label: line for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}
        order = [*laws, *(label for label in entries if label not in laws)]
        columns = min(len(order), 4 if len(shown) > 1 else 2)
        handles = [entries[label] for label in order]
        page.legend(handles, order, loc="outside lower center", ncols=columns, frameon=False)
    return page


def _panel(axes: Any, mode: str, laws: Mapping[str, Law], curves: list[tuple[Curve, str]]) -> None:
    rest = MODES[mode].rest
    low, high = RANGES[mode]
    if curves:
        low = min(rest, *(curve.stretches.min() for curve, _ in curves))
        high = max(rest, *(curve.stretches.max() for curve, _ in curves))
    stretches = np.linspace(low, high, SAMPLES)
    for (label, law), (colour, dash) in zip(laws.items(), LINES, strict=False):
        axes.plot(stretches, stress(law, mode, stretches) / 1e3, color=colour, ls=dash, lw=1.8, label=label)
    for curve, mark in curves:
        look = {"ls": "", "marker": mark, "ms": 4.5, "mfc": "white", "mec": "#222222", "mew": 1.0}
        axes.plot(curve.stretches, curve.stress / 1e3, label=f"data: {curve.label}", zorder=3, **look)
    axes.axhline(0, color="#999999", lw=0.6, zorder=0)
    axes.axvline(rest, color="#999999", lw=0.6, zorder=0)
    axes.grid(color="#e8e8e8", lw=0.6)
    axes.set_axisbelow(True)
    axes.set_title(mode)
    axes.set_xlabel("stretch λ" if rest else "amount of shear γ")


def plot_catalogue(entries: Sequence[Published]) -> Any:
    """Plot nominal stress (kPa) of published laws in tension, compression and shear, each over the stretches of its data.

    Parameters
    ----------
    entries : sequence of Published
        Entries of the catalogue. A viscoelastic one has two lines of one colour: instantaneous, and thin in
        equilibrium. One that no data limit is drawn over the usual stretches.

    Returns
    -------
    matplotlib.figure.Figure
        Two panels. A shear γ counts as the stretches 1 ± γ/2, so that a material measured in tension or compression
        alone has no line in shear.

    Raises
    ------
    InputError
        No entry, or more than distinguishable line styles.

    Examples
    --------
    >>> from ngbrain.materials import constants
    >>> page = plot_catalogue([constants("budday2017:cortex"), constants("griffiths2024:cortex")])
    >>> [axes.get_xlabel() for axes in page.axes]
    ['stretch λ', 'amount of shear γ']
    """
    return _plot_materials([(entry.name, viscous(entry.law()), entry.stretch) for entry in entries])


def plot_law(law: Law | Viscous | Maxwell | Branch) -> Any:
    """Plot nominal stress (kPa) of a law in tension, compression and shear, as `plot_catalogue` does.

    Parameters
    ----------
    law : Law, Viscous, Maxwell or Branch
        Elastic or viscoelastic law, or a branch, of which the spring is drawn; with real numbers as parameters. A law of the
        catalogue is drawn over the stretches of its data, another one over the usual stretches.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        A law that has no stress in a homogeneous test, such as one whose parameters vary in space.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke
    >>> len(plot_law(NeoHooke(1000.0)).axes[0].lines[0].get_xdata())
    121
    """
    law = law.law if isinstance(law, Maxwell | Branch) else law
    if isinstance(getattr(law, "mu", 0.0), complex):
        raise InputError("law", "of a complex modulus, for waves", "one of real parameters, which has a stress")
    entry = find_entry(law)
    stretch = entry.stretch if entry else RANGES["uniaxial"]
    return _plot_materials([(entry.name if entry else describe_law(viscous(law)), viscous(law), stretch)])


def plot_entry(entry: Published) -> Any:
    """Plot nominal stress (kPa) of one published material, see `plot_catalogue`."""
    return plot_catalogue([entry])


def _plot_materials(materials: Sequence[tuple[str, Viscous, tuple[float, float]]]) -> Any:
    """Plot viscoelastic materials, each by its name and over its stretches."""
    looks = [(colour, dash) for dash in ("-", (0, (5, 1.6)), (0, (1.5, 1.5))) for colour, _ in LINES]
    if not 0 < len(materials) <= len(looks):
        wanted = f"1 to {len(looks)}, so that lines stay distinguishable"
        raise InputError("entries", f"{len(materials)} of them", wanted)
    with require("matplotlib", "report").rc_context(STYLE):
        page = figure(8.6, 3.9 + 0.2 * (len(materials) // 2))
        panels = page.subplots(1, 2)
        for (name, law, stretch), (colour, dash) in zip(materials, looks, strict=False):
            shown = [(instantaneous_law(law), 1.8)] + ([(law.equilibrium, 0.9)] if law.branches else [])
            for axes, mode in zip(panels, ("uniaxial", "shear"), strict=True):
                low, high = stretch if all(map(math.isfinite, stretch)) else RANGES["uniaxial"]
                if mode == "shear":
                    high = 2 * min(1 - low, high - 1)
                    low = -high
                if low == high:
                    continue
                at = np.linspace(low, high, SAMPLES)
                for each, width in shown:
                    label = name if width > 1 else f"{name}, equilibrium"
                    axes.plot(at, stress(each, mode, at) / 1e3, color=colour, ls=dash, lw=width, label=label)
        for axes, title, name, rest in zip(
            panels,
            ("tension and compression", "simple shear"),
            ("stretch λ", "amount of shear γ"),
            (1.0, 0.0),
            strict=True,
        ):
            axes.axhline(0, color="#999999", lw=0.6, zorder=0)
            axes.axvline(rest, color="#999999", lw=0.6, zorder=0)
            axes.grid(color="#e8e8e8", lw=0.6)
            axes.set_axisbelow(True)
            axes.set_title(title)
            axes.set_xlabel(name)
        panels[0].set_ylabel("nominal stress (kPa)")
        page.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return page
