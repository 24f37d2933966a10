"""Tables of the page on harmonic waves."""

from _pages import records
from _tables import Record, bullets, compared, count, number, percent, seconds, spread, table, verdict

ERRORS = (1e-1, 1e-2, 1e-3, 1e-4)
LOSSES = {0.0: "without loss", 0.2: "with loss"}


def _waves(xi: float) -> list[Record]:
    """The case of most wave lengths."""
    longest = max(r["kL"] for r in records("harmonic_order"))
    return [r for r in records("harmonic_order") if (r["kL"], r["xi"]) == (longest, xi)]


def behind() -> str:
    worst = max(_gradients(), key=lambda r: r["ratio"])
    return bullets([
        *(f"Waves {LOSSES[xi]}. {verdict(_waves(xi), ERRORS)}" for xi in LOSSES),
        f"The dearest gradient takes {number(worst['ratio'])} of its waves ({worst['fields']}, {worst['form']}, {worst['loads']}).",
    ])  # fmt: skip


def waves() -> str:
    return "\n\n".join(
        f"**{LOSSES[xi][0].upper()}{LOSSES[xi][1:]}**\n\n{compared(_waves(xi), ERRORS)}" for xi in LOSSES
    )


def ten() -> str:
    """Errors of each order with about ten unknowns for a wave length."""
    cells = []
    for order in sorted({r["order"] for r in _waves(0.0) if r["method"].startswith("ngbrain")}):
        of = [r for r in _waves(0.0) if r["method"] == f"ngbrain:P{order}"]
        near = min(of, key=lambda r: abs(r["per_wavelength"] - 10))
        cells.append([str(order), number(near["per_wavelength"], 3), percent(near["error"])])
    return table(("order", "unknowns for a wave length", "off by"), cells)


def finest() -> str:
    """Codes beside each other at order four on the finest mesh that all have."""
    of = [r for r in _waves(0.0) if r["order"] == 4 and r["converged"]]
    sizes = [{r["ndof"] for r in of if r["method"] == m} for m in dict.fromkeys(r["method"] for r in of)]
    largest = max(set.intersection(*sizes))
    texts = [f"{r['method'].replace(':', ' ')} {seconds(r['cpu_s'])}" for r in of if r["ndof"] == largest]
    return f"Order 4, {count(largest)} unknowns: {', '.join(texts)}."


def _gradients() -> list[Record]:
    return [r for r in records("gradient_cost") if r["method"] == "ngbrain:adjoint"]


def gradients() -> str:
    rows = []
    for r in _gradients():
        key = ("case", "fields", "form", "loads")
        matrix = next(
            (
                o
                for o in records("gradient_cost")
                if o["method"].startswith("assembled") and all(o[k] == r[k] for k in key)
            ),
            None,
        )
        rows.append([
            r["case"], r["fields"], r["form"], r["loads"], count(r["ndof"]), seconds(r["waves_s"]), number(r["ratio"]),
            number(r["adjoints"]), number(matrix["ratio"] / r["ratio"]) if matrix and matrix["ratio"] else "–", f"{r['error']:.0e}",
        ])  # fmt: skip
    titles = (
        "case", "fields", "form", "loads", "unknowns", "waves", "gradient over waves", "solves alone", "as a matrix, over that",
        "off differences by",
    )  # fmt: skip
    return table(titles, rows)


def gradients_conclusion() -> str:
    texts = []
    for form in dict.fromkeys(r["form"] for r in _gradients()):
        of = [r["ratio"] for r in _gradients() if r["form"] == form]
        texts.append(f"{form} {spread(of)}")
    return f"A gradient over its waves, by form: {'; '.join(texts)}."
