"""Tables of the page on derivatives."""

from _pages import records
from _tables import MISSING, Record, bullets, count, listing, name, number, percent, seconds, spread, table

ASKED = 0.2
"""A gradient of an equilibrium at large strain over the equilibrium."""


def _statics() -> list[Record]:
    return [r for r in records("gradient_cost_statics") if r["converged"]]


def _linear(method: str) -> dict[tuple[str, int], Record]:
    return {(r["form"], r["tetrahedra"]): r for r in _statics() if r["case"] == "linear" and r["method"] == method}


def behind() -> str:
    missed = [
        f"{r['form']}, {count(r['ndof'])} unknowns: {number(r['ratio'])}" for r in _statics()
        if r["case"] == "large strain" and r["method"] == "ngbrain:adjoint" and r["ratio"] > ASKED
    ]  # fmt: skip
    ours, by_hand = _linear("ngbrain:adjoint"), _linear("dolfinx by hand")
    both = [key for key in ours if key in by_hand]
    solve = spread(by_hand[key]["forward_s"] / ours[key]["forward_s"] for key in both)
    mine, theirs = (spread(found[key]["ratio"] for key in both) for found in (ours, by_hand))
    time = [r for r in _through_time() if r["method"] == "ngbrain:adjoint" and r["ratio"] > 1]
    dear = ", ".join(f"{r['law']} with {r['steps']} steps {number(r['ratio'])}" for r in time)
    return bullets([
        f"Gradients at large strain that cost more of an equilibrium than was asked, a fifth: {'; '.join(missed)}.",
        f"dolfinx solves the linear cube in {solve} of our time, and a gradient by hand is {theirs} of its solve, ours {mine}.",
        f"Gradients through time that cost more than a run: {dear}.",
    ])  # fmt: skip


def conclusion() -> str:
    texts = []
    for method in dict.fromkeys(r["method"] for r in _statics() if r["case"] == "linear"):
        small = [r["ratio"] for r in _linear(method).values()]
        texts.append(f"{name(method)} {spread(small)}")
    return f"A gradient of the linear cube over its solve: {'; '.join(texts)}."


def statics() -> str:
    columns = {
        "case": ("case", str), "method": ("method", name), "form": ("form", str), "tetrahedra": ("tetrahedra", count),
        "unknowns": ("ndof", count), "solve": ("forward_s", seconds), "gradient": ("cpu_s", seconds),
        "gradient over solve": ("ratio", number), "error": ("error", lambda e: f"{e:.0e}"), "failed": ("reason", str),
    }  # fmt: skip
    return listing(records("gradient_cost_statics"), columns)


def _through_time() -> list[Record]:
    return [r for r in records("gradient_through_time") if r["method"] != "differences"]


def time() -> str:
    """A row for each law, size and number of steps."""
    methods = list(dict.fromkeys(r["method"] for r in _through_time()))
    rows = []
    for key in dict.fromkeys((r["law"], r["ndof"], r["steps"], r["unknowns"]) for r in _through_time()):
        of = {r["method"]: r for r in _through_time() if (r["law"], r["ndof"], r["steps"], r["unknowns"]) == key}
        cells = []
        for method in methods:
            r = of.get(method)
            memory = f", {number(r['memory_mb'])} MB" if r and r["memory_mb"] else ""
            cells.append(f"{number(r['ratio'])}{memory}" if r else MISSING)
        rows.append([key[0], *map(count, key[1:]), seconds(next(iter(of.values()))["run_s"]), *cells])
    return table(("law", "unknowns of a body", "steps", "parameters", "run", *map(name, methods)), rows)


def time_conclusion() -> str:
    def over(method: str, maxwell: bool) -> str:
        return spread(
            r["ratio"] for r in _through_time() if r["method"] == method and ("Maxwell" in r["law"]) == maxwell
        )

    first, second = "ngbrain:adjoint", "ngbrain:second derivatives"
    return (
        f"A gradient through time costs {over(first, False)} runs with hereditary branches and {over(first, True)} with a Maxwell"
        f" branch; a product with second derivatives {over(second, False)} and {over(second, True)}."
    )


def errors() -> str:
    worst = max(r["error"] for r in _statics() if r["method"].startswith("ngbrain") and r["error"] is not None)
    return f"Gradients of equilibria are off differences by {worst:.0e} at most ({percent(worst)})."
