"""Error against time: a line for each method, the front of the best, and what failed; and where the time went."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from itertools import cycle
from typing import Any

from ngbrain.errors import require
from ngbrain.look import STYLE

OURS = "ngbrain:"
STRONG = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9")
MUTED = {"NGSolve": "#4d4d4d", "dolfinx": "#8c7853", "FElupe": "#8a7a9b", "scikit-fem": "#7f9a8a"}
SPARE = ("#a3a3a3", "#b09a8a", "#8fa3b3")
MARKERS = "sv^D<>P*X"
LINES = ("-", "--", ":", "-.")
PHASES = {"compile": "#c9b458", "assemble": "#0072B2", "factor": "#D55E00", "solve": "#009E73"}
PHASES |= {"check": "#CC79A7", "other": "#bdbdbd"}


def looks(methods: Iterable[str]) -> dict[str, dict[str, Any]]:
    """How each method is drawn: ours strong and first, others muted; colour says the library, marker the element."""
    methods = list(dict.fromkeys(methods))
    spare, known = cycle(SPARE), dict(MUTED)
    found: dict[str, dict[str, Any]] = {}
    for k, method in enumerate(m for m in methods if m.startswith(OURS)):
        again, k = divmod(k, len(STRONG))
        style = {"color": STRONG[k], "marker": "oDs"[again % 3], "linestyle": LINES[again % len(LINES)]}
        found[method] = style | {"lw": 2.2, "ms": 6, "zorder": 4}
    others = sorted((m for m in methods if m not in found), key=lambda m: m.split()[0].lower())
    elements = list(dict.fromkeys(m.partition(" ")[2] for m in methods if m in others))
    for method in others:
        library, _, element = method.partition(" ")
        k = elements.index(element)
        colour = known.setdefault(library, next(spare) if library not in known else "")
        style = {"color": colour, "marker": MARKERS[k % len(MARKERS)], "linestyle": LINES[k % len(LINES)]}
        found[method] = style | {"lw": 1.2, "ms": 4.5, "zorder": 3}
    return found


def pareto(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those that no other point beats in both, from the left."""
    best: list[tuple[float, float]] = []
    for x, y in sorted(points):
        if not best or y < best[-1][1]:
            best.append((x, y))
    return best


def front(
    records: list[dict],
    axes: Any,
    x: str = "cpu_s",
    xlabel: str = "CPU time, one thread (s)",
    ylabel: str = "relative error",
    title: str = "",
    styles: dict[str, dict[str, Any]] | None = None,
    size: str = "n",
    legend: bool = True,
) -> None:
    """Draw `error` against `x` on log axes; a marker is a mesh, its `size` is written at the ends of our lines.

    What did not converge is a cross on top at its time (without one: at the right), its reason in the legend.
    Records whose reason begins "not offered" or "not installed" are left out.
    """
    records = [r for r in records if not str(r.get("reason", "")).startswith(("not offered", "not installed"))]
    styles = styles or looks(r["method"] for r in records)
    good = [r for r in records if r["converged"] and r["error"]]
    if not good:
        raise ValueError("no record converged: nothing to draw")
    best = pareto((r[x], r["error"]) for r in good)
    low, high = min(r["error"] for r in good), max(r["error"] for r in good)
    left = min(r[x] for r in records if r[x])
    right = max(r[x] for r in records if r[x])
    if len(best) > 1:
        across, down = zip(*best, strict=True)
        axes.plot(
            across, down, color="#f2d35b", lw=7, alpha=0.45, solid_capstyle="round", zorder=1, label="best for the time"
        )
    fallen = list(dict.fromkeys(r["method"] for r in records if not r["converged"]))
    for method, style in styles.items():
        rows = sorted((r for r in records if r["method"] == method), key=lambda r: (r["ndof"] or 0, r.get("n") or 0))
        if not rows:
            continue
        done = [r for r in rows if r in good]
        bad = [r for r in rows if not r["converged"]]
        label = method + _failures(bad, size)
        axes.loglog([r[x] for r in done], [r["error"] for r in done], label=label, **style)
        if method.startswith(OURS):
            for r in done[:1] + done[1:][-1:]:
                axes.annotate(
                    f"{r.get(size)}",
                    (r[x], r["error"]),
                    (5, 4),
                    textcoords="offset points",
                    fontsize=7,
                    color=style["color"],
                )
        height = 2.6 * 2.6 ** (fallen.index(method) / max(1, len(fallen) - 1)) * high if bad else high
        for r in bad:
            axes.plot(r[x] or 1.6 * right, height, "x", color=style["color"], ms=7, mew=2, zorder=5)
    axes.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel, title=title)
    failed = any(not r["converged"] for r in records)
    axes.set(ylim=(low / 2, (8 if failed else 2) * high), xlim=(left / 1.5, 2 * right))
    if failed:
        axes.axhline(2 * high, color="#999999", lw=0.6)
        axes.annotate("failed", (0.01, 4.2 * high), xycoords=("axes fraction", "data"), va="center", fontsize=8)
    axes.grid(alpha=0.25, lw=0.6)
    if legend:
        many = sum(text.count("\n") + 1 for text in axes.get_legend_handles_labels()[1]) > 18
        axes.legend(
            loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=6.5 if many else 8, frameon=False, handlelength=3
        )


def _failures(bad: list[dict], size: str) -> str:
    """What a legend says of the crosses, one line for each reason."""
    reasons = defaultdict(list)
    for r in bad:
        reasons[short(r.get("reason", ""))].append(str(r.get(size)))
    return "".join(f"\n   × at {', '.join(who)}: {why}" for why, who in reasons.items())


def short(reason: str) -> str:
    """A reason in a few words."""
    if reason.startswith("load factor"):
        return f"stopped at {reason.split(' was')[0]}"
    for sign, words in {
        "finite": "diverged",
        "NaN": "diverged",
        "DIVERGED": "diverged",
        "iterations": "no end",
    }.items():
        if sign in reason:
            return words
    return reason if len(reason) <= 40 else reason[:39] + "…"


def bars(records: list[dict], axes: Any, labels: Iterable[str] | None = None, title: str = "") -> None:
    """Where the CPU time went, a bar for each record; what its phases do not name is "other"."""
    rows = [r for r in records if r["converged"] and r.get("cpu_s")]
    names = list(labels) if labels is not None else [f"{r['method']}, n = {r['n']}" for r in rows]
    start = [0.0] * len(rows)
    for phase, colour in PHASES.items():
        known = [sum(r.get("phases", {}).values()) for r in rows]
        if phase == "other":
            widths = [max(0.0, r["cpu_s"] - k) for r, k in zip(rows, known, strict=True)]
        else:
            widths = [r.get("phases", {}).get(phase, 0.0) for r in rows]
        axes.barh(names, widths, left=start, color=colour, label=phase, height=0.65)
        start = [s + w for s, w in zip(start, widths, strict=True)]
    for name, r in zip(names, rows, strict=True):
        axes.annotate(
            f"{r['cpu_s']:.2g} s", (r["cpu_s"], name), (4, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.invert_yaxis()
    axes.set(xlabel="CPU time, one thread (s)", title=title)
    axes.margins(x=0.12)
    axes.legend(
        fontsize=8,
        frameon=False,
        ncols=6,
        columnspacing=1,
        handlelength=1.2,
        loc="upper left",
        bbox_to_anchor=(0, -0.12),
    )


def figure(width: float, height: float, panels: int = 1, rows: int = 1, **options: Any) -> tuple[Any, Any, Any]:
    """pyplot, a figure in the house style and its panels, so many in each row."""
    plt = require("matplotlib.pyplot", "report")
    plt.rcParams.update(STYLE)
    made, axes = plt.subplots(rows, panels, figsize=(width, height), layout="constrained", **options)
    return plt, made, axes
