"""The page of a twin: the conclusion, plans side by side, the head with its map and corridors, assumptions, credibility."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.report.pages.page import write_page
from ngbrain.report.pictures.style import SPARE, figure, png, style
from ngbrain.surgery.quantities import QUANTITIES

PLANS = ("#0072B2", "#D55E00", "#009E73", *SPARE)
"""Colours of the plans, in order."""
GREY = "#4d4d4d"
MOST_SHARES = 6
"""Rows of the table of sources of uncertainty."""


def build(path: str | os.PathLike[str], result: Mapping[str, Any]) -> Path:
    """Write the page of a result of the command `twin`.

    Parameters
    ----------
    path : str or path-like
        Output file.
    result : mapping of str to Any
        The result.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is not installed.
    """
    pictures = {"plans": _in_style(compare_figure, result), "head": _in_style(head_figure, result)}
    return write_page(
        Path(path),
        "twin.html",
        pictures,
        result=result,
        names={key: quantity.label for key, quantity in QUANTITIES.items()},
        next_steps=next_steps(result),
        colours=dict(zip(result["answers"], PLANS, strict=False)),
    )


def _in_style(draw: Any, result: Mapping[str, Any]) -> bytes:
    with style():
        return png(draw(result))


def next_steps(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """For each pair of plans and measure that is open: what its uncertainty comes from, largest first."""
    decided = {(d["first"], d["second"], d["measure"]): d["decision"] for d in result["differences"]}
    found = []
    for each in result["variance_shares"]["differences"]:
        shares = list(each["shares"].items())[:MOST_SHARES]
        key = each["first"], each["second"], each["measure"]
        found.append(
            {**each, "shares": shares, "open": decided[key] == "open", "name": QUANTITIES[each["measure"]].label}
        )
    return found


def compare_figure(result: Mapping[str, Any]) -> Any:
    """Medians and intervals of all plans, a panel for each measure, with published thresholds.

    Parameters
    ----------
    result : mapping
        Of `twin`.

    Returns
    -------
    matplotlib Figure
    """
    plans = list(result["answers"])
    measures = list(result["answers"][plans[0]])
    row = 0.34 * len(plans)
    height = len(measures) * (row + 0.95) + 0.15
    made = figure(height)
    for i, key in enumerate(measures):
        bottom = height - (i + 1) * (row + 0.95) + 0.5
        axis = made.add_axes((0.2, bottom / height, 0.76, row / height))
        ends = list[float]()
        for j, plan in enumerate(plans):
            found = result["answers"][plan][key]
            low, high = found["interval_95"]
            axis.plot([low, high], [j, j], color=PLANS[j % len(PLANS)], lw=3, solid_capstyle="butt")
            axis.plot(found["median"], j, "o", color=PLANS[j % len(PLANS)], ms=8)
            if found["runs"]:
                axis.plot(found["runs"], [j + 0.28] * len(found["runs"]), "|", color=GREY, ms=7, mew=1.2)
            ends += [low, high, *found["runs"]]
        near = [t for t in result["thresholds"] if t["measure"] == key and 0.3 * min(ends) < t["value"] < 2 * max(ends)]
        for value in sorted({t["value"] for t in near}):
            axis.axvline(value, color="#8a1c1c", lw=1, ls=":")
            axis.annotate(
                f"{value:g}",
                (value, 1),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="bottom",
                fontsize=8,
                color="#8a1c1c",
            )
        axis.set(ylim=(len(plans) - 0.4, -0.6), yticks=range(len(plans)), yticklabels=plans)
        axis.set_xlim(left=0.0)
        axis.set_xlabel(QUANTITIES[key].label)
    return made


def head_figure(result: Mapping[str, Any]) -> Any:
    """Three sections of the head with the map (or the regions) and the corridors of the plans.

    Parameters
    ----------
    result : mapping
        Of `twin`.

    Returns
    -------
    matplotlib Figure
    """
    made = figure(3.6)
    sections = result["sections"]
    mapped = sections[0]["ratio"] is not None
    image = None
    for i, section in enumerate(sections):
        axis = made.add_axes((0.01 + 0.297 * i, 0.1, 0.285, 0.8))
        region = np.array(section["region"])
        shown = np.array(section["ratio"], float) if mapped else np.where(region < 0, np.nan, region).astype(float)
        limits = {"vmin": 0.5, "vmax": 2.0, "cmap": "viridis"} if mapped else {"cmap": "Greys", "vmin": -3, "vmax": 4}
        image = axis.imshow(shown, origin="lower", extent=section["extent_mm"], **limits)
        for number in range(len(section["regions"])):
            if (region == number).any():
                left, right, bottom, top = section["extent_mm"]
                xs, ys = np.linspace(left, right, region.shape[1]), np.linspace(bottom, top, region.shape[0])
                axis.contour(xs, ys, (region == number).astype(float), [0.5], colors="#333333", linewidths=0.5)
        for j, (plan, corridor) in enumerate(result["corridors"].items()):
            entry, target = (np.array(corridor[key])[section["axes"]] for key in ("entry_mm", "target_mm"))
            axis.plot(*np.array([entry, target]).T, color=PLANS[j % len(PLANS)], lw=max(6.0 - 2.5 * j, 1.5), label=plan)
            axis.plot(*target, "o", color=PLANS[j % len(PLANS)], ms=max(9 - 3 * j, 4), mec="white", mew=0.6)
        axis.set_aspect("equal")
        axis.set_xticks([]), axis.set_yticks([])
        axis.set_title(section["view"], fontsize=10, loc="center")
        for spine in axis.spines.values():
            spine.set_visible(False)
        if i == 0:
            axis.legend(
                frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(0, -0.16), ncols=len(result["corridors"])
            )
    if mapped and image is not None:
        bar = made.colorbar(image, cax=made.add_axes((0.905, 0.2, 0.012, 0.6)))
        bar.set_label("|G*| over its mean norm")
    return made
