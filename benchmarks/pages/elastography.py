"""Tables of the page on elastography in the plane."""

from statistics import median

from _pages import records
from _tables import (
    FIELDS,
    Record,
    bullets,
    by_field,
    count,
    listing,
    median_and_worst,
    name,
    number,
    percent,
    reach,
    seconds,
    spread,
    table,
    verdict,
)  # fmt: skip

NOISY = (5e-2, 2e-2, 1.2e-2)
CLEAN = (1e-1, 1e-2, 1e-3, 1e-4)
FIBRES = "transversely_isotropic"
FACTORS = ("nested dissection", "NGSolve")
COMBINED = ("shear_along", "shear_stretch")


def _noise(level: float) -> list[Record]:
    return [r for r in records("inversion_noise") if r["noise"] == level]


def _cases() -> dict[str, dict[tuple[bool, bool], Record]]:
    """case → (in our elements, with noise) → record."""
    found: dict[str, dict[tuple[bool, bool], Record]] = {}
    for r in records("inversion_cases"):
        found.setdefault(r["case"], {})[r["method"].endswith("our elements"), r["noise"] > 0] = r
    return found


def behind() -> str:
    lines = [f"CV-G, {percent(n)} noise. {verdict(_noise(n), NOISY if n else CLEAN, stays=False)}" for n in _levels()]
    alone = [r for r in records("inversion_seeds") if r["start"] == "uniform"]
    stuck = [r for r in alone if r["error"] > 0.2]
    cases = ", ".join(sorted({r["case"] for r in stuck}))
    ends = spread((r["error"] for r in stuck), percent)
    lines.append(
        f"From uniform fields alone {len(stuck)} of {len(alone)} inversions end {ends} off ({cases});"
        " measured waves start them right."
    )
    return bullets(lines)


def _levels() -> list[float]:
    return sorted({r["noise"] for r in records("inversion_noise")})


def cases() -> str:
    rows = []
    for case, at in _cases().items():
        clean, noisy, ours, ours_noisy = at[False, False], at[False, True], at[True, False], at[True, True]
        rows.append([
            case, by_field(clean["errors"]), by_field(noisy["errors"]), seconds(noisy["cpu_s"]), by_field(ours_noisy["errors"]),
            percent(ours["mismatch"]), seconds(ours_noisy["cpu_s"]),
        ])  # fmt: skip
    titles = (
        "case", "without noise", "1 % noise on every point", "CPU time", "1 % noise, in our elements",
        "waves of the truth off the data in them", "CPU time",
    )  # fmt: skip
    return table(titles, rows)


def noise() -> str:
    parts = []
    for level in _levels():
        tolerances = NOISY if level else CLEAN
        parts.append(f"**{percent(level)} noise**\n\n{reach(_noise(level), tolerances, stays=False)}")
    return "\n\n".join(parts)


def noise_ends() -> str:
    """What each method ends with at each level, and when."""
    last = {}
    for r in records("inversion_noise"):
        if (key := (r["method"], r["noise"])) not in last or r["cpu_s"] > last[key]["cpu_s"]:
            last[key] = r
    rows = []
    for method in dict.fromkeys(m for m, _ in last):
        of = [last.get((method, level)) for level in _levels()]
        rows.append([name(method), *(f"{percent(r['error'])}, {seconds(r['cpu_s'])}" if r else "–" for r in of)])
    return table(("method", *(f"{percent(level)} noise" for level in _levels())), rows)


def seeds() -> str:
    found = records("inversion_seeds")
    starts = list(dict.fromkeys(r["start"] for r in found))
    rows = []
    for case, level in dict.fromkeys((r["case"], r["noise"]) for r in found):
        cells = []
        for start in starts:
            of = [r for r in found if (r["case"], r["noise"], r["start"]) == (case, level, start)]
            cells.append(f"{median_and_worst([r['errors'] for r in of])}, {seconds(median(r['cpu_s'] for r in of))}")
        rows.append([case, percent(level), *cells])
    return table(("case", "noise", *(f"start: {start}" for start in starts)), rows)


def bodies() -> str:
    found = records("inversion_bodies")
    rows = []
    for body in dict.fromkeys(r["body"] for r in found):
        of = [r for r in found if r["body"] == body]
        clean = next(r for r in of if r["noise"] == 0 and r["chosen"])
        uniform = next(r for r in of if r["noise"] == 0 and r["start"] == "uniform")
        noisy = [r for r in of if r["noise"] > 0 and r["chosen"]]
        rows.append([
            body.replace(FIBRES, "fibres"), f"{clean['points']} × {clean['points']}", by_field(_told(clean)),
            percent(uniform["error"]),
            median_and_worst([_told(r) for r in noisy]), seconds(median(r["cpu_s"] for r in noisy)),
        ])  # fmt: skip
    titles = ("body", "points", "without noise", "uniform start alone", "2 % noise, median (worst)", "CPU time")
    return table(titles, rows)


def _told(record: Record) -> dict[str, float]:
    """The errors of what waves in a plane tell of a body."""
    of = {key: error for key, error in record["errors"].items() if key in FIELDS}
    combined = {key: of[key] for key in COMBINED if key in of}
    nearly = record["body"].startswith(FIBRES) and "nearly" in record["body"]
    return combined if nearly and combined else {key: error for key, error in of.items() if key not in COMBINED}


def grids() -> str:
    found = [r for r in records("inversion_grids") if "errors" in r]
    columns = {
        "points": ("points", count), "elements": ("n_elements", count), "way": ("method", str),
        "off by": ("errors", _discs), "factorisations": ("factorisations", count), "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    return listing(found, columns)


def _discs(errors: dict[str, float]) -> str:
    names = {"storage": "G′", "hard": "hard disc", "soft": "soft disc"}
    return ", ".join(f"{names[name]} {percent(error)}" for name, error in errors.items())


def factorisations() -> str:
    found = [r for r in records("inversion_grids") if "errors" not in r]
    rows = []
    for ndof in dict.fromkeys(r["ndof"] for r in found):
        ours, other = (next(r for r in found if r["ndof"] == ndof and r["method"] == f) for f in FACTORS)
        rows.append([
            count(ndof), seconds(ours["cpu_s"]), seconds(other["cpu_s"]), number(other["cpu_s"] / ours["cpu_s"]),
            f"{ours['refinements']} and {other['refinements']}",
        ])  # fmt: skip
    titles = ("unknowns and equations", "nested dissection", "NGSolve", "ratio", "refinements of one solve")
    return table(titles, rows)


def fibres() -> str:
    columns = {
        "bulk modulus": ("bulk", lambda b: f"{number(b / 1e3)} kPa"), "loads": ("drives", str),
        "frequencies": ("frequencies", lambda f: ", ".join(number(x) for x in f) + " Hz"),
        "off by": ("errors", by_field), "numbers determined": ("determined", _numbers), "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    return listing(records("fibre_loads"), columns)


def _numbers(determined: dict[str, float]) -> str:
    return ", ".join(f"{FIELDS[key]} {number(value)}" for key, value in determined.items())


def bars() -> str:
    columns = {
        "case": ("case", str), "under": ("method", lambda m: m.replace("ngbrain:evidence", "the prior that fits best")),
        "draws": ("seeds", count), "noise": ("noise", percent), "95 % intervals hold": ("coverage_95", lambda c: percent(c, 3)),
        "single draws": ("coverage_by_draw", lambda each: spread(each, percent)),
        "68 % intervals hold": ("coverage_68", lambda c: percent(c, 3)),
        "error of G' and G''": ("l2", lambda errors: ", ".join(percent(e) for e in errors)),
        "CPU time": ("cpu_s", seconds), "of the bars": ("bars_s", seconds),
    }  # fmt: skip
    return listing(records("uncertainty_seeds"), columns)
