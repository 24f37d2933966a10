"""Tables of the page on statics."""

import numpy as np
from _pages import records
from _tables import MISSING, bullets, compared, count, name, number, seconds, table, verdict

SMOOTH = (1e-2, 1e-3, 1e-4, 1e-5)
COOK = (1e-2, 3e-3, 1e-3, 1e-4)
BLOCK = (1e-1, 5e-2, 3e-2, 2.5e-2)


def behind() -> str:
    finest = max(r["n"] for r in records("statics_block"))
    mine, other = (
        min(
            (r for r in records("statics_block") if r["n"] == finest and start in r["method"]), key=lambda r: r["cpu_s"]
        )
        for start in ("ngbrain:auto", "dolfinx")
    )
    lines = [
        f"Cube pressed smoothly. {verdict(records('statics_smooth'), SMOOTH)}",
        f"Cook's membrane. {verdict(records('statics_cook'), COOK)}",
        f"Bonded cube. {verdict(records('statics_block'), BLOCK)} With {count(mine['ndof'])} unknowns, where factors are all"
        f" the work, {name(mine['method'])} takes {seconds(mine['cpu_s'], 3)}, {other['method']} {seconds(other['cpu_s'], 3)}.",
    ]
    return bullets(lines)


def smooth() -> str:
    return compared(records("statics_smooth"), SMOOTH)


def cook() -> str:
    return compared(records("statics_cook"), COOK)


def block() -> str:
    return compared(records("statics_block"), BLOCK)


def failed() -> str:
    rows = [
        [of, name(r["method"]), str(r["n"]), str(r["corners"]), seconds(r["cpu_s"]), r["reason"]]
        for of in ("smooth", "cook", "block")
        for r in records(f"statics_{of}")
        if not r["converged"] and not r["reason"].startswith("not ")
    ]
    return table(("problem", "method", "n", "refinements of corners", "CPU time", "reason"), rows)


def scaling() -> str:
    rows = [
        [
            f"{r['case']}, order {r['order']}, K/μ = {number(r['ratio'])}", name(r["method"]), count(r["ndof"]),
            seconds(r["cpu_s"], 3), f"{number(r['memory_gib'])} GiB" if r["memory_gib"] else MISSING,
            str(r["iterations"] or MISSING), r["reason"],
        ]
        for r in records("statics_scaling")
    ]  # fmt: skip
    return table(("system", "solver", "unknowns", "CPU time", "memory", "iterations", "failed"), rows)


def growth() -> str:
    """The power of the unknowns that each solver's time grows with, from its two largest systems."""
    found, texts = records("statics_scaling"), []
    for key in dict.fromkeys((r["case"], r["order"], r["ratio"], r["method"]) for r in found):
        of = [r for r in found if (r["case"], r["order"], r["ratio"], r["method"]) == key and r["converged"]]
        if len(of) > 1:
            last = sorted(of, key=lambda r: r["ndof"])[-2:]
            power = np.log(last[1]["cpu_s"] / last[0]["cpu_s"]) / np.log(last[1]["ndof"] / last[0]["ndof"])
            texts.append(f"{name(key[3])} ({key[0]}, order {key[1]}) n^{power:.1f}")
    return f"Between its two largest systems the time grows as: {'; '.join(texts)}."
