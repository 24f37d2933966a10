"""Tables of the page on the surrogate."""

from functools import cache
from statistics import fmean, median

from _pages import records
from _tables import MISSING, Record, bullets, count, listing, name, number, percent, seconds, spread, table

MODALITIES = ("compression", "waves")
GAUSSIAN = ("gaussian_place", "gaussian_width")
SMOOTH = (*GAUSSIAN, "sinusoidal", "sinc")
PARTS = ("edge", "plateau")
NOISE = 0.01
TOLD = 0.9
"""The area under the curve from which on outsiders count as told."""


@cache
def _operator() -> dict[tuple[str, str, float, float], list[Record]]:
    """The operator's records by modality, family, noise and grain."""
    found: dict[tuple[str, str, float, float], list[Record]] = {}
    for r in records("surrogate_error"):
        if r["method"] == "ngbrain:surrogate":
            found.setdefault((r["modality"], r["family"], r["noise"], r["grain"]), []).append(r)
    return found


def _errors(modality: str, family: str, noise: float, grain: float = 0.0, part: str | None = None) -> list[float]:
    of = _operator().get((modality, family, noise, grain), [])
    return [r["error"] if part is None else r["parts"][part] for r in of if part is None or r["parts"]]


def _mean(families: tuple[str, ...], modality: str, noise: float, grain: float = 0.0) -> float | None:
    each = [_errors(modality, family, noise, grain) for family in families]
    return fmean(error for errors in each for error in errors) if any(each) else None


def _families() -> list[str]:
    return list(dict.fromkeys(r["family"] for r in records("surrogate_error")))


def behind() -> str:
    lines = []
    for modality in MODALITIES:
        smooth, spots = _mean(SMOOTH, modality, NOISE), _mean(GAUSSIAN, modality, NOISE)
        off = f"Gaussian spots {percent(spots)}, all smooth families {percent(smooth, 3)} off"
        lines.append(f"{modality}, {percent(NOISE)} noise: {off}.")
    outsiders = [
        r for r in records("surrogate_trust") if r.get("auc") is not None and not r["who"].startswith("as learnt")
    ]
    untold = [
        f"{r['modality']}, {r['who']} (area under the curve {number(r['auc'])}, {percent(r['error'])} off)"
        for r in outsiders if r["auc"] < TOLD
    ]  # fmt: skip
    return bullets([*lines, f"Outsiders that are not told: {'; '.join(untold)}."])


def families() -> str:
    noises = sorted({r["noise"] for r in records("surrogate_error")})
    rows = []
    for modality in MODALITIES:
        groups = {family.replace("_", " "): (family,) for family in _families()}
        groups |= {"Gaussian spots": GAUSSIAN, "all smooth families": SMOOTH}
        for shown, of in groups.items():
            rows.append([modality, shown, *(percent(_mean(of, modality, noise)) for noise in noises)])
    return table(("", "family", *(f"{percent(noise)} noise" for noise in noises)), rows)


def grained() -> str:
    found = [r for r in records("surrogate_error") if r["grain"]]
    noises, grain = sorted({r["noise"] for r in found}), found[0]["grain"]
    rows = []
    for family in _families():
        cells = [percent(_mean((family,), "compression", noise, grain)) for noise in noises]
        rows.append([family.replace("_", " "), *cells])
    return table(("family", *(f"{percent(noise)} noise, grained" for noise in noises)), rows)


def edges() -> str:
    rows = []
    for modality in MODALITIES:
        for family in _families():
            parts = [_errors(modality, family, NOISE, part=part) for part in PARTS]
            if parts[0]:
                rows.append([modality, family, *(percent(fmean(errors)) for errors in parts)])
    return table(("", "sharp family, 1 % noise", "at edges", "on plateaus"), rows)


def methods() -> str:
    """Every method on the two samples that all methods have, and where it is at edges and on plateaus."""
    slow = [r for r in records("surrogate_error") if r["method"].startswith("ngbrain:NLI")]
    samples = {(r["family"], r["sample"]) for r in slow}
    noises = sorted({r["noise"] for r in slow})
    rows = []
    for modality in MODALITIES:
        every = [
            r for r in records("surrogate_error")
            if r["modality"] == modality and not r["grain"] and (r["family"], r["sample"]) in samples
        ]  # fmt: skip
        for method in dict.fromkeys(r["method"] for r in every):
            of = [r for r in every if r["method"] == method]
            cells = []
            for noise in noises:
                errors = [r["error"] for r in of if r["noise"] == noise]
                cells.append(percent(fmean(errors)) if errors else MISSING)
            parts = [[r["parts"][part] for r in of if r["parts"] and r["noise"] == NOISE] for part in PARTS]
            cells += [percent(fmean(errors)) if errors else MISSING for errors in parts]
            cost = seconds(median(r["cpu_s"] for r in of if r["noise"] == NOISE))
            rows.append([modality, METHODS.get(method, name(method)), *cells, cost])
    titles = (
        "",
        "method",
        *(f"{percent(noise)} noise" for noise in noises),
        "edges, 1 %",
        "plateaus, 1 %",
        "CPU time, 1 %",
    )
    return table(titles, rows)


METHODS = {
    "ngbrain:surrogate": "the operator", "ngbrain:surrogate, checked": "so too, checked",
    "ngbrain:surrogate + 2 GN": "and two rounds of Gauss-Newton", "ngbrain:NLI": "inversion",
    "ngbrain:NLI, every second point": "inversion, every second point", "ngbrain:DI": "algebraic",
    "ngbrain:LFE": "local frequency", "ngbrain:1/strain": "strain image",
}  # fmt: skip


def starts() -> str:
    found = records("surrogate_start")
    rows = []
    for family, sample in dict.fromkeys((r["family"], r["sample"]) for r in found):
        at = {r["start"]: r for r in found if (r["family"], r["sample"]) == (family, sample)}
        cells = [
            f"{percent(at[s]['errors'][0])} → {percent(at[s]['error'])}, {_arrives(at[s])}"
            for s in ("surrogate", "uniform")
        ]
        rows.append([family.replace("_", " "), str(sample), *cells])
    return table(("family", "sample", "from the operator's map", "from a uniform field"), rows)


def _arrives(record: Record) -> str:
    solves = record["solves_to"]
    return "does not arrive" if solves is None else f"arrives after {solves} solves"


def starts_conclusion() -> str:
    found = records("surrogate_start")
    by = {
        start: {(r["family"], r["sample"]): r["solves_to"] for r in found if r["start"] == start}
        for start in ("surrogate", "uniform")
    }
    both = [key for key, solves in by["uniform"].items() if solves is not None and by["surrogate"].get(key) is not None]
    alone = [key for key, solves in by["surrogate"].items() if solves is not None and by["uniform"].get(key) is None]
    mine = spread((by["surrogate"][key] for key in both), count)
    theirs = spread((by["uniform"][key] for key in both), count)
    return (
        f"Where both arrive ({len(both)} of {len(by['uniform'])}) the operator's map takes {mine} solves, a uniform field {theirs};"
        f" {len(alone)} more arrive from the map alone."
    )


def trust() -> str:
    columns = {
        "": ("modality", str), "who": ("who", str), "area under the curve": ("auc", number), "told by": ("told_by", str),
        "flagged": ("flagged", percent), "error": ("error", percent),
    }  # fmt: skip
    return listing(records("surrogate_trust"), columns)


def insiders() -> str:
    lines = []
    for r in records("surrogate_trust"):
        if r["who"] == "insiders":
            held = ", ".join(
                f"{percent(float(level))}: {percent(shares[0])}" for level, shares in r["coverage"].items()
            )
            lines.append(
                f"{r['modality']}: intervals hold (first answer) {held}; learnt on 51 points across and asked on 101 the error is"
                f" {number(r['finer'], 3)} times; a map of 64 × 64 points with its deviations takes {seconds(r['map_s'])},"
                f" {count(r['maps_per_s'])} a second."
            )
    return bullets(lines)


def training() -> str:
    columns = {
        "": ("modality", str), "network": ("network", str), "width": ("width", str), "levels": ("levels", str),
        "samples": ("samples", count), "epochs": ("epochs", str), "weights": ("ndof", count),
        "Gaussian spots off by": ("error", percent), "CPU time": ("cpu_s", lambda s: f"{number(s / 60)} min"),
    }  # fmt: skip
    return listing(records("surrogate_training"), columns)
