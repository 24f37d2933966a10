"""Coverage of intervals by level, and its chart."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from _front import figure, looks
from scipy.special import ndtri

Record = dict
LEVELS = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.68, 0.8, 0.9, 0.95, 0.99]
ASKED = ((0.68, 0.60, 0.76), (0.95, 0.90, 0.99))


def coverage(scores: np.ndarray) -> Record:
    """Coverage from errors in standard deviations; `error` is |coverage - .95| at 95 %."""
    covered = [float(np.mean(np.abs(scores) < ndtri(0.5 + level / 2))) for level in LEVELS]
    at = dict(zip(LEVELS, covered, strict=True))
    return {
        "error": abs(at[0.95] - 0.95),
        "levels": LEVELS,
        "coverage": covered,
        "coverage_68": at[0.68],
        "coverage_95": at[0.95],
    }


def told(r: Record) -> str:
    """One record as text."""
    return f"68 % cover {100 * r['coverage_68']:.1f} %, 95 % cover {100 * r['coverage_95']:.1f} %"


def chart(records: list[Record], png: str, panel: Callable[[Record], str], of: str, width: float) -> None:
    """Coverage against level, a panel (`width` inches) for each title that records have: right on the diagonal."""
    titles, styles = list(dict.fromkeys(map(panel, records))), looks(r["method"] for r in records)
    plt, made, panels = figure(width * len(titles) + 0.4, width + 0.9, len(titles), squeeze=False)
    for axes, title in zip(panels[0], titles, strict=True):
        axes.plot([0, 1], [0, 1], color="#999999", lw=1)
        for level, low, high in ASKED:
            axes.plot([level, level], [low, high], color="#f2d35b", lw=7, alpha=0.6, solid_capstyle="butt")
        for r in (r for r in records if panel(r) == title):
            axes.plot(r["levels"], r["coverage"], label=r["method"], **styles[r["method"]])
        axes.set(xlabel="level", ylabel=f"share of {of} inside", title=title, xlim=(0, 1), ylim=(0, 1))
        axes.grid(alpha=0.25, lw=0.6)
    made.legend(*panels[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    made.savefig(png, dpi=130)
    plt.close(made)
