"""The chart of `gpu.py`: time against unknowns, applications by order, and whole inversions."""

from __future__ import annotations

import textwrap

from _front import figure

Record = dict
PROBLEMS = ("elasticity", "mixed", "waves")
COLOURS = {
    "cg, device": "#D55E00", "minres, device": "#D55E00", "tfqmr, device": "#D55E00",
    "cg in single precision, refined, device": "#CC79A7", "cholesky, device": "#E69F00", "cudss, device": "#009E73",
    "assembled, device": "#D55E00", "matrix-free, device": "#009E73",
}  # fmt: skip
PROCESSOR = ("#0072B2", "#56B4E9", "#4d4d4d", "#a3a3a3")
MISSING = "not measured: no GPU was at hand"


def chart(records: list[Record], png: str) -> None:
    """Draw what was measured, failures (ended after 20 s, or a residual over 1e-8) as crosses.

    On a reference device nothing counts as measured.
    """
    plt, made, axes = figure(11, 10, 3, 2)
    rows = [r | {"method": r["method"].rpartition(": ")[2]} for r in records]
    bandwidth = max(
        (r["bytes_per_s"] for r in rows if r.get("bytes_per_s") and r["device"] not in ("", "host")), default=None
    )
    for axis, problem in zip(axes.flat[:3], PROBLEMS, strict=True):
        solving(axis, problem, [r for r in rows if r["problem"] == problem and r["n"] > 3], bandwidth)
    applying(axes.flat[3], [r for r in rows if r["problem"].startswith("stiffness")])
    inverting(axes.flat[4], [r for r in rows if r["problem"].startswith("inversion")])
    axes.flat[5].axis("off")
    about = [*machine(rows), "* measured in GNU Octave on another machine"]
    axes.flat[5].text(-0.1, 1, "\n".join(textwrap.fill(part, 52) for part in about), va="top", fontsize=7)
    made.suptitle("Solving on a GPU and on the processor", fontsize=11)
    made.savefig(png, dpi=130)
    plt.close(made)


def counts(record: Record) -> bool:
    """Whether its time is that of the processor, or of a real GPU."""
    return not record["method"].endswith("device") or record["device"] != "host"


def seconds(record: Record) -> float:
    """To set up and solve; the cap where a method was ended."""
    return float(record["setup_s"] + record["solve_s"]) if "solve_s" in record else 20.0


def colour(method: str, spare: list[str]) -> str:
    """Fixed for devices, in turn for the processor."""
    return COLOURS.get(method) or spare.pop(0)


def solving(axis: object, problem: str, rows: list[Record], bandwidth: float | None) -> None:
    """Seconds to set up and solve, by unknowns."""
    spare = list(PROCESSOR)
    for method in dict.fromkeys(r["method"] for r in rows):
        own = sorted((r for r in rows if r["method"] == method and counts(r)), key=lambda r: r["ndof"] or 0)
        good = [r for r in own if r["converged"]]
        failed = [r for r in own if not r["converged"] and not r.get("missing") and r["ndof"]]
        if not good and not failed:
            continue
        shade = colour(method, spare)
        axis.loglog(
            [r["ndof"] for r in good],
            [seconds(r) for r in good],
            "o-",
            color=shade,
            label=method,
            ms=4,
        )
        axis.plot([r["ndof"] for r in failed], [seconds(r) for r in failed], "x", color=shade)
        if bandwidth and method in ("cg, device", "minres, device", "tfqmr, device"):
            limit = [r["iterations"] * 12 * r["entries"] / bandwidth for r in good]
            axis.plot([r["ndof"] for r in good], limit, ":", color=shade, label="limit of the memory's bandwidth")
    axis.set(title=problem, xlabel="thousand unknowns", ylabel="seconds to set up and solve")
    sizes = sorted({r["ndof"] for r in rows if r["ndof"]})
    axis.set_xticks(sizes, [f"{size / 1000:.0f}" for size in sizes])
    axis.minorticks_off()
    absent(axis, [r for r in rows if r["method"].endswith("device") and counts(r) and not r.get("missing")])


def applying(axis: object, rows: list[Record]) -> None:
    """Seconds of one application, by order."""
    spare = list(PROCESSOR)
    for method in dict.fromkeys(r["method"] for r in rows):
        own = sorted(
            (r for r in rows if r["method"] == method and counts(r) and r["converged"]), key=lambda r: r["order"]
        )
        if own:
            axis.semilogy(
                [r["order"] for r in own], [r["solve_s"] for r in own], "o-", color=colour(method, spare), label=method
            )
    axis.set(title="stiffness, about 100 000 unknowns", xlabel="order", ylabel="seconds of one application")
    absent(axis, [r for r in rows if r["method"].endswith("device") and counts(r) and not r.get("missing")])


def inverting(axis: object, rows: list[Record]) -> None:
    """Whole inversions over MatNLI's time on the published case, or in seconds."""
    own = [r for r in rows if r.get("solve_s") and counts(r)]
    names = [f"{r['problem'].split(' ', 1)[1]}\n{r['method']}" for r in own]
    axis.barh(range(len(own)), [r["solve_s"] for r in own], color="#0072B2")
    for k, r in enumerate(own):
        ratio = r.get("over_matnli")
        axis.text(
            r["solve_s"],
            k,
            f" {r['solve_s']:.3g} s" + (f", 1/{1 / ratio:.0f} of MatNLI's*" if ratio else ""),
            va="center",
            fontsize=7,
        )
    axis.set(yticks=range(len(own)), xlabel="seconds", title="inversions")
    axis.set_yticklabels(names, fontsize=7)
    axis.margins(x=0.5)
    absent(axis, [r for r in own if r["method"].endswith("device")], legend=False)


def absent(axis: object, rows: list[Record], legend: bool = True) -> None:
    """Say where no GPU was measured."""
    if legend and axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize=6.5, frameon=False, loc="upper left", bbox_to_anchor=(0, -0.16))
    axis.grid(alpha=0.25)
    if not rows:
        axis.text(0.5, 0.02, MISSING, transform=axis.transAxes, ha="center", fontsize=7, color="#D55E00")


def machine(rows: list[Record]) -> list[str]:
    """What was loaded, and on what."""
    found = [
        f"{r['method']}: {r.get('name') or ''} {r.get('version') or ''} {r['reason']}"
        for r in rows
        if r["problem"] == "loading"
    ]
    made = next((r["run"] for r in rows if "run" in r), {})
    return [made.get("machine", ""), made.get("date", ""), *found]
