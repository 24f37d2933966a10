"""Tables of the page on inverse problems of any energy."""

from statistics import median

from _pages import records
from _tables import MISSING, Record, bullets, count, listing, name, number, percent, seconds, spread, table

NAMES = {
    "mu": "μ", "fast": "g₁", "tau_fast": "τ₁", "slow": "g₂", "tau_slow": "τ₂", "rest": "μ∞", "spring": "μ₁", "eta": "η",
}  # fmt: skip
"""What numbers of laws are called."""
LOST = 0.5


def _named(key: str) -> str:
    return NAMES.get(key, key.replace("_", " "))


def behind() -> str:
    lost = [
        f"{r['problem']} by {name(r['method'])} ({r['grid']}, {percent(r['noise'])} noise): {percent(r['error'])}"
        for r in records("inversion_relaxing") if r["error"] > LOST
    ]  # fmt: skip
    out = [
        f"{r['head'].replace('_', ' ')}, {name(r['method'])}, {percent(r['noise'])} noise: {_named(tissue)}"
        for r in records("inversion_retraction") for tissue, (low, high) in r["intervals"].items()
        if not low <= r["truth"][tissue] <= high
    ]  # fmt: skip
    low = min(
        records("uncertainty_coverage"), key=lambda r: r["coverage_95"] if r["method"].startswith("ngbrain") else 1
    )
    return bullets([
        f"Lost in relaxing bodies: {'; '.join(lost) or 'none'}.",
        f"Truths outside of their intervals in retracted brains: {'; '.join(out) or 'none'}.",
        f"At worst 95 % intervals hold {percent(low['coverage_95'])} ({name(low['method'])}, {percent(low['noise'])} noise).",
    ])  # fmt: skip


def relaxing() -> str:
    """The largest errors of the seeds, a row for each problem, mesh and noise."""
    found = [r for r in records("inversion_relaxing") if r["method"] == "ngbrain:levenberg-marquardt"]
    rows = []
    for key in dict.fromkeys((r["problem"], r["grid"], r["noise"]) for r in found):
        of = [r for r in found if (r["problem"], r["grid"], r["noise"]) == key]
        errors = (
            ", ".join(f"{_named(k)} {number(100 * max(abs(r['errors'][k]) for r in of))}" for k in of[0]["errors"])
            + " %"
        )
        shape = of[0].get("mismatch_shape")
        rows.append([
            key[0], key[1], percent(key[2]), percent(of[0]["mismatch"]), percent(shape), str(len(of)), errors,
            spread(r["misfit"] for r in of), number(median(r["in_runs"] for r in of)),
        ])  # fmt: skip
    titles = (
        "problem", "elements", "noise", "mismatch", "of its shape", "seeds", "largest errors", "misfit over expected",
        "CPU time in runs, median",
    )  # fmt: skip
    return table(titles, rows)


def relaxing_searches() -> str:
    of = records("inversion_relaxing")[0]
    found = [r for r in records("inversion_relaxing") if all(r[key] == of[key] for key in ("seed", "noise", "grid"))]
    methods = list(dict.fromkeys(r["method"] for r in found))
    rows = []
    for problem in dict.fromkeys(r["problem"] for r in found):
        at = {r["method"]: r for r in found if r["problem"] == problem}
        rows.append(
            [
                problem,
                *(
                    f"{number(at[m]['in_runs'])} runs, {percent(at[m]['error'])}" if m in at else MISSING
                    for m in methods
                ),
            ]
        )
    return table(("problem", *map(name, methods)), rows)


def ball() -> str:
    found = records("inversion_hyperelastic")
    methods = list(dict.fromkeys(r["method"] for r in found))
    rows = []
    for key in dict.fromkeys((r["case"], r["noise"], r["unknowns"]) for r in found):
        at = {r["method"]: r for r in found if (r["case"], r["noise"], r["unknowns"]) == key}
        cells = [
            f"{number(at[m]['error'])}, {number(at[m]['contrast'])}, {number(at[m]['forwards'])}"
            if m in at
            else MISSING
            for m in methods
        ]
        rows.append([key[0], percent(key[1]), count(key[2]), *cells])
    return table(("", "noise", "parameters", *map(name, methods)), rows)


def problems() -> str:
    columns = {
        "problem": ("problem", str), "method": ("method", name), "loads": ("loads", str), "unknowns": ("ndof", count),
        "start": ("start_degrees", lambda d: f"{number(d)}°"), "rounds": ("rounds", count), "off by": ("error", percent),
        "μ": ("error_mu", percent), "α": ("error_alpha", percent), "k₁": ("error_k1", percent),
        "misfit over expected": ("misfit_over_expected", number), "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    return listing((r for r in records("inversion_problems") if r.get("case") != "search"), columns)


def problem_searches() -> str:
    columns = {
        "problem": ("problem", str), "noise": ("noise", percent), "method": ("method", name),
        "in times of all equilibria from rest": ("sets", number), "rounds": ("rounds", count), "off by": ("error", percent),
        "μ": ("error_mu", percent), "α": ("error_alpha", percent), "k₁": ("error_k1", percent), "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    found = [r for r in records("inversion_problems") if r.get("case") == "search"]
    return listing(sorted(found, key=lambda r: (r["problem"], r["noise"], r["sets"])), columns)


def _factors(record: Record) -> str:
    texts = []
    for tissue, (low, high) in record["intervals"].items():
        found, truth = record["factors"][tissue], record["truth"][tissue]
        texts.append(f"{tissue} {number(found, 4)} ({number(low, 3)} to {number(high, 3)}; truly {number(truth)})")
    return ", ".join(texts)


def retraction() -> str:
    rows = []
    for r in records("inversion_retraction"):
        held = (
            ", ".join(f"{tissue} {n}" for tissue, n in r["held"].items()) + f" of {r['seeds']}"
            if r.get("held")
            else MISSING
        )
        rows.append([
            r["head"].replace("_", " "), count(r["tetrahedra"]), percent(r["noise"]), name(r["method"]), _factors(r),
            number(r["misfit_over_expected"]), held, number(r.get("in_runs")), seconds(r["cpu_s"]),
        ])  # fmt: skip
    titles = (
        "head", "tetrahedra", "noise", "method", "factors (95 % interval; truth)", "misfit over expected",
        "draws whose intervals hold the truth", "in runs", "CPU time",
    )  # fmt: skip
    return table(titles, rows)


def coverage() -> str:
    columns = {
        "intervals": ("method", name), "noise": ("noise", percent), "repetitions": ("repetitions", count),
        "68 % intervals hold": ("coverage_68", lambda c: percent(c, 3)), "95 %": ("coverage_95", lambda c: percent(c, 3)),
        "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    return listing(records("uncertainty_coverage"), columns)


def models() -> str:
    columns = {
        "": ("case", str), "intervals": ("method", name), "noise": ("noise", percent), "repetitions": ("repetitions", count),
        "left open": ("refused", count), "68 % intervals hold": ("coverage_68", lambda c: percent(c, 3)),
        "95 %": ("coverage_95", lambda c: percent(c, 3)),
    }  # fmt: skip
    return listing(records("uncertainty_models"), columns)
