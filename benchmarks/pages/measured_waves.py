"""Tables of the page on measured waves."""

from _pages import records
from _tables import MISSING, Record, bullets, count, number, percent, seconds, spread, table


def _each() -> list[Record]:
    return [r for r in records("living_slice") if len(r["frequency"]) == 1]


def _hz(record: Record) -> str:
    return f"{number(record['frequency'][0])} Hz" if len(record["frequency"]) == 1 else "all four"


def behind() -> str:
    found = records("living_slice")
    ratios = ", ".join(f"{_hz(r)} {number(r['ratio'], 3)}" for r in found)
    (exponent,) = (r["checks"]["exponent"] for r in found if len(r["frequency"]) > 1)
    ranks = ", ".join(f"{_hz(r)} {number(r['rank'])}" for r in found)
    unusable = sum(not r["usable"] for r in found)
    reasons = "\n".join(f"  - {_hz(r)}: {'; '.join(r['reasons'])}" for r in found)
    return bullets(
        [
            f"A living brain, G' over the authors' map: {ratios}; the exponent of all four: {number(exponent)}; rank"
            f" correlations: {ranks}.",
            f"{unusable} of {len(found)} answers are said not to be usable:\n{reasons}",
        ]
    )


def slices() -> str:
    rows = []
    for r in records("living_slice"):
        median = f"{number(r['storage'] / 1e3, 3)} + {number(r['loss'] / 1e3, 3)}i kPa"
        noise = [percent(r["noise"][key]) for key in ("stated", "estimated")]
        rows.append([
            _hz(r), f"{number(r['ratio'], 3)}, {number(r['rank'])}",
            f"{number(r['helmholtz_ratio'])}, {number(r['helmholtz_rank'])}",
            f"{number(r['lfe_ratio'], 3)}, {number(r['lfe_rank'])}", median, *noise, "yes" if r["checks"]["converged"] else "no",
            seconds(r["cpu_s"]),
        ])  # fmt: skip
    titles = (
        "", "G' over the authors' map, rank correlation", "Helmholtz inversion", "local frequency, ours", "median G*",
        "noise stated", "noise found", "settled", "CPU time",
    )  # fmt: skip
    return table(titles, rows)


def multiples() -> str:
    """What multiples of the authors' map leave of the displacement."""
    rows = []
    for unknown, about in (("rim", ""), ("sources", ", smooth sources unknown too")):
        for r in _each():
            of = r["against"][unknown]
            least = min(of["left"])
            cells = [f"**{number(left)}**" if left == least else number(left) for left in of["left"]]
            rows.append([f"{_hz(r)}{about}", *cells, number(of["ours"]), number(r["noise"]["stated"])])
    factors = [number(f, 3) for f in _each()[0]["against"]["factors"]]
    return table(("factor on the authors' map", *factors, "our map", "images' noise"), rows)


def spectrum() -> str:
    rows = []
    for r in _each():
        of = r["wavelengths"]
        rows.append([_hz(r), f"{number(of['median_mm'])} mm", f"{number(of['authors_mm'])} mm", percent(of["shorter"])])
    return table(
        ("", "half of the energy is in waves longer than", "the authors' modulus has", "energy in waves so short"), rows
    )


def bad_points() -> str:
    rows = []
    for r in records("bad_points"):
        contrasts = ", ".join(number(c, 3) for c in r["contrasts"].values()) if r.get("contrasts") else MISSING
        left = (
            f"{count(r['left_out'])} of {count(r['wrong'])}, {count(r['left_out_good'])}"
            if "left_out" in r
            else MISSING
        )
        name = {
            "file": "a uniform slab of eight slices, 6 % of the rim's points",
            "rim": "at the rim",
            "none": "none",
        }.get(r["method"], f"{r['method']} anywhere")
        median = f"{number(r['storage'] / 1e3, 4)} + {number(r['loss'] / 1e3, 3)}i kPa"
        rows.append([name, median, contrasts, left, "yes" if r["usable"] else "no", seconds(r["cpu_s"])])
    discs = ", ".join(next(r for r in records("bad_points") if r.get("contrasts"))["contrasts"])
    titles = (
        "gross errors",
        "background",
        f"contrasts ({discs})",
        "left out, good ones with them",
        "usable",
        "CPU time",
    )
    return table(titles, rows)


def bad_points_conclusion() -> str:
    off = [
        abs(found - float(truth)) / abs(float(truth) - 1)
        for r in records("bad_points") for truth, found in r.get("contrasts", {}).items()
    ]  # fmt: skip
    backgrounds = spread((r["error"] for r in records("bad_points")), percent)
    return (
        f"The background is {backgrounds} off, with and without gross errors; contrasts miss {spread(off, percent)} of what they"
        " differ from one by."
    )
