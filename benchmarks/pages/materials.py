"""Tables of the page on materials."""

import numpy as np
from _pages import records
from _tables import count, listing, name, number, percent, seconds, spread, table


def laws() -> str:
    columns = {
        "law": ("law", str), "by": ("method", lambda m: m.partition(":")[0]), "1 - R²": ("error", number),
        "assembly": ("cpu_s", seconds), "over Neo-Hooke's": ("ratio", number), "not compiled, over the same": ("plain", number),
    }  # fmt: skip
    return listing(records("materials_cost"), columns)


def laws_conclusion() -> str:
    of = {r["law"]: r for r in records("materials_cost") if r["method"].startswith("ngbrain")}
    mooney, ogden, two = of["Mooney-Rivlin"], of["Ogden"], of["Ogden, two terms"]
    return (
        f"Mooney-Rivlin has the asymmetry of compression and tension for {number(mooney['ratio'], 3)} times the cost of Neo-Hooke"
        f" (1 - R² = {number(mooney['error'])}; its c₁₀ is negative); one-term Ogden has the stiffening too for"
        f" {number(ogden['ratio'])} times ({number(ogden['error'])}), a second term brings {number(two['error'])} for"
        f" {number(two['ratio'])}."
    )


def known() -> str:
    found = [r for r in records("bonded_fits") if r["case"] == "known"]
    rows = []
    for key in dict.fromkeys((r["method"], r["maxh"], r["noise"]) for r in found):
        of = [r for r in found if (r["method"], r["maxh"], r["noise"]) == key]
        errors, alphas = [r["error"] for r in of], [r["parameters"]["alpha"] for r in of]
        rows.append([
            name(key[0]), f"{number(1e3 * key[1], 3)} mm" if key[1] else "", percent(key[2]), str(len(of)),
            percent(np.median(errors)), percent(max(errors)), number(np.median(alphas), 3),
            spread(r["r2"]["compression"] for r in of), seconds(np.median([r["cpu_s"] for r in of])),
        ])  # fmt: skip
    titles = ("fit", "elements", "noise", "seeds", "median", "worst", "α", "R² in compression", "CPU time")
    return table(titles, rows)


def searches() -> str:
    columns = {
        "search": ("method", name), "sets": ("sets", count), "solves": ("solves", count), "CPU time": ("cpu_s", seconds),
        "error": ("error", percent),
    }  # fmt: skip
    return listing((r for r in records("bonded_fits") if r["case"] == "search"), columns)


def measured_curves() -> str:
    columns = {
        "region": ("region", lambda r: r.replace("_", " ")), "fit": ("method", name),
        "elements": ("maxh", lambda h: f"{number(1e3 * h, 3)} mm"), "μ": ("parameters.mu", lambda m: f"{number(m / 1e3, 3)} kPa"),
        "α": ("parameters.alpha", lambda a: number(a, 3)), "R² in compression": ("r2.compression", number),
        "tension": ("r2.tension", number), "shear": ("r2.shear", number), "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    return listing((r for r in records("bonded_fits") if r["case"] == "measured"), columns)


def steps() -> str:
    """A row for each number of steps, a column for each method."""
    found = records("flow_steps")
    methods = list(dict.fromkeys(r["method"] for r in found))
    rows = []
    for case, n in dict.fromkeys((r["case"], r["steps"]) for r in found):
        at = {r["method"]: r for r in found if (r["case"], r["steps"]) == (case, n)}
        cells = [
            f"{percent(at[m]['error'])}, {seconds(at[m]['cpu_s'])}" if at[m]["converged"] else "failed" for m in methods
        ]
        rows.append([case, count(n), *cells])
    return table(("relaxation time", "steps", *map(name, methods)), rows)
