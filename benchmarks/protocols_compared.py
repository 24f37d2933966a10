"""Pressure by retraction protocol, and relaxation by published constants against measurements.

One point of tissue under a blade (`ngbrain.surgery.material_point`), every relaxing set of constants of the catalogue,
openings of 0.1
to 18 % of its depth. `hold`: opened in 0.5 to 150 s and held for half an hour: what is left of the peak (Awasthi 2020, dogs:
35 %) and when half is (Hongo 1987: 6.6 minutes). `protocol`: half an hour of work in one hold against holds with rests, stages,
and by force; `value` is their measure over that of the one hold, so above 1 the one hold is better, or a time where the measure
says so. `rate`: the peak at .5 to 50 mm/s over that at .5 mm/s. `block`: holds with rests on a 20 mm block in space. `error`:
relative, of `value` with half as many steps (block: ten times the tolerance).

    python benchmarks/protocols_compared.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/protocols_compared.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import _front
import ngsolve as ngs
import numpy as np
from _command import main
from scipy.optimize import brentq

from ngbrain.errors import RangeWarning, SolverError
from ngbrain.forward import ErrorControl, Material, Problem, RigidContact, TimeStepper
from ngbrain.materials import Branch, Scaled, Viscous, constants
from ngbrain.mesh import block
from ngbrain.surgery import (
    Column,
    Drive,
    LoadingHistory,
    ToolMotion,
    continuous_retraction,
    dose,
    dose_with_recovery,
    intermittent_retraction,
    staged_retraction,
)
from ngbrain.units import to_minutes, to_mmHg

SETS = {
    f"griffiths2024:{name}": name.replace("_", " ")
    for name in ("cortex", "white_matter", "corpus_callosum", "deep_grey")
}
SETS |= {"miller1997:brain": "Miller 1997", "miller2002:brain": "Miller 2002"}
OPENING, RAMP, WORK = 5e-3, 10.0, 1800.0
STRAINS = np.array([1e-3, 0.05, 0.1, 0.15, 0.18])
"""Opening relative to depth; Griffiths' data end at 10 %."""
PATTERNS = ((300.0, 300.0), (600.0, 180.0), (900.0, 300.0))
"""Hold and rest (s); the rest begins when the blade is fully retracted."""
RISES = (0.5, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 150.0)
HALVED, LEFT = 6.6, 0.35
FORCES = {"30 gf": 0.294 / 2e-4, "50 gf": 0.490 / 2e-4}
"""On 10 × 20 mm (Pa)."""
DRAINED = ((0.1, 60.0), (0.5, 600.0))
"""Share of the initial stress that is lost by fluid drainage, and its time constant (s)."""
SPEEDS = (0.5, 2.0, 10.0, 50.0)
STEPS = 16
LEVELS = (20.0, 30.0)
Values = Iterator[dict]
"""Records without cost and error: their keys, and `value`."""


def rests(hold: float, rest: float) -> ToolMotion:
    """Half an hour of working time in holds."""
    n = round(WORK / hold)
    return intermittent_retraction(OPENING, RAMP, n * (RAMP + hold) + (n - 1) * (RAMP + rest), hold, RAMP + rest)


def half_time(course: LoadingHistory) -> float:
    """Minutes from the peak to half of it; NaN if it is never reached."""
    top = course.pressure.argmax()
    below = course.curve.crossings(to_mmHg(course.pressure[top]) / 2)
    after = below[below > course.t[top]]
    return float(to_minutes(after[0] - course.t[top])) if after.size else np.nan


def holds(column: Column, strains: np.ndarray, rises: tuple[float, ...]) -> Values:
    """Remaining share of the peak after half an hour, and the half-time."""
    for rise in rises:
        for strain, course in zip(
            strains, column.push_each(OPENING / strains, continuous_retraction(OPENING, rise, rise + WORK)), strict=True
        ):
            of = {"kind": "hold", "strain": strain, "rise_s": rise}
            yield of | {"measure": "left", "value": course.pressure[-1] / course.pressure.max()}
            yield of | {"measure": "half-time (min)", "value": half_time(course)}


def against(one: LoadingHistory, on: LoadingHistory, many: LoadingHistory) -> Iterator[tuple[str, str, float]]:
    """Comparison, measure and value of holds with rests against one hold of equal working time, and of equal total time."""
    a, b = one.curve, many.curve
    work, peaks = dose(a), many.peaks() / one.pressure.max()
    yield "equal work", "first peak", peaks[0]
    yield "equal work", "last peak", peaks[-1]
    yield "equal work", "mean of peaks", peaks.mean()
    kept = many.pressure[np.searchsorted(many.t, many.events[2::5])] / many.peaks()
    yield "equal work", "kept in the last hold over kept in the first", kept[-1] / kept[0]
    yield "equal work", "dose", dose(b) / work
    yield "equal time", "dose of the first half hour", dose(b, one.t[-1]) / work
    yield "equal time", "dose to the end", dose(b) / dose(on.curve)
    even = brentq(lambda log: dose_with_recovery(b, np.exp(log)) - work, 0.0, 40.0)
    yield "equal work", "recovery that makes doses equal (min)", to_minutes(np.exp(even))
    for level in LEVELS:
        (whole, longest), (whole_b, longest_b) = a.above(level), b.above(level)
        if whole > 60:
            yield "equal work", f"time above {level:.0f} mmHg", whole_b / whole
            yield "equal work", f"longest above {level:.0f} mmHg", longest_b / longest


def rested(column: Column, strains: np.ndarray, patterns: tuple[tuple[float, float], ...]) -> Values:
    """Protocol of holds with rests."""
    depths = OPENING / strains
    ones = column.push_each(depths, continuous_retraction(OPENING, RAMP, RAMP + WORK))
    for hold, rest in patterns:
        protocol = rests(hold, rest)
        ons = column.push_each(depths, continuous_retraction(OPENING, RAMP, protocol.times[-1]))
        for strain, *courses in zip(strains, ones, ons, column.push_each(depths, protocol), strict=True):
            of = {"kind": "protocol", "strain": strain, "pattern": f"{hold:.0f}/{rest:.0f} s"}
            of["peak_mmHg"] = float(to_mmHg(courses[0].pressure.max()))
            for comparison, measure, value in against(*courses):
                yield of | {"comparison": comparison, "measure": measure, "value": value}


def stages(column: Column, strains: np.ndarray) -> Values:
    """Five stages a minute apart, with release between them or not; then held as long as one hold, or to its end."""
    depths, all_open = OPENING / strains, RAMP + 4 * 60.0
    ones = column.push_each(depths, continuous_retraction(OPENING, RAMP, RAMP + WORK))
    for protocol in (staged_retraction(OPENING, RAMP, all_open + WORK, 5, 60.0), higher(5, 60.0)):
        for strain, a, b in zip(strains, ones, column.push_each(depths, protocol), strict=True):
            of = {"kind": "protocol", "strain": strain, "pattern": protocol.name, "comparison": protocol.name}
            yield of | {"measure": "peak", "value": b.pressure.max() / a.pressure.max()}
            yield of | {"measure": "dose, equal time", "value": dose(b.curve, a.t[-1]) / dose(a.curve)}
            yield of | {"measure": "dose, equal work", "value": dose(b.curve) / dose(a.curve)}


def higher(stages: int, rest: float) -> ToolMotion:
    """Each opening further than the one before it, all at one rate, with the blade let go for `rest` s; the last one is held."""
    times, advance = [0.0], [0.0]
    for stage in range(1, stages + 1):
        way, hold = RAMP * stage / stages, WORK if stage == stages else rest
        back = [(way, 0.0), (rest, 0.0)] if stage < stages else []
        for length, end in [(way, OPENING * stage / stages), (hold, OPENING * stage / stages), *back]:
            times.append(times[-1] + length)
            advance.append(end)
    return ToolMotion("stages, let go between", tuple(times), tuple(advance))


def forced(column: Column) -> Values:
    """A blade of prescribed force: its advance, and the dose of that force, at equal working time."""
    protocol = rests(*PATTERNS[0])
    open_ = np.array(protocol.advance) > 0
    for name, force in FORCES.items():
        one = column.load((0.0, RAMP, RAMP + WORK), (0.0, force, force))
        many = column.load(protocol.times, tuple(force * open_))
        of = {
            "kind": "protocol",
            "pattern": name,
            "comparison": "given force",
            "strain": one.advance.max() / column.depth,
        }
        yield of | {"measure": "opening at the end", "value": many.advance[-1] / one.advance[-1]}


def speeds(column: Column, strains: np.ndarray) -> Values:
    """The peak against the opening rate."""
    depths = OPENING / strains
    runs = [
        column.push_each(depths, continuous_retraction(OPENING, OPENING / (1e-3 * v), OPENING / (1e-3 * v) + 60))
        for v in SPEEDS
    ]
    for speed, courses in zip(SPEEDS, runs, strict=True):
        for strain, course, slow in zip(strains, courses, runs[0], strict=True):
            yield {
                "kind": "rate",
                "strain": strain,
                "mm_s": speed,
                "measure": "peak",
                "value": course.pressure.max() / slow.pressure.max(),
            }


def drained(material: Viscous, share: float, tau: float) -> Viscous:
    """The tissue with a fluid that bears `share` of an initial stress and drains with the time constant `tau`: one more branch."""
    return Viscous(
        material.equilibrium, (*material.branches, Branch(Scaled(material.instantaneous, share / (1 - share)), tau))
    )


def of_set(name: str, steps: int, quick: bool) -> Values:
    """All records of one set of constants."""
    material = constants(name).law()
    column = Column(material, OPENING / 0.1, "planar", steps)
    strains, patterns = (STRAINS[[2]], PATTERNS[:1]) if quick else (STRAINS, PATTERNS)
    yield from holds(column, strains, RISES[::3] if quick else RISES)
    yield from rested(column, strains, patterns)
    yield from stages(column, strains)
    yield from speeds(column, strains)
    if "griffiths" in name:  # the others give way without end under such a force
        yield from forced(column)
    for share, tau in () if quick else DRAINED:
        wet = Column(drained(material, share, tau), column.depth, column.mode, steps)
        for found in rested(wet, STRAINS[[0, 2]], patterns[:1]):
            yield found | {"comparison": f"drained, {found['comparison']}", "share": share, "tau_s": tau}


def blocks(tolerance: float, strain: float = 0.1) -> Values:
    """The same protocols under a plate on a bonded block of white matter."""
    size, entry, hold = 0.02, constants("griffiths2024:white_matter"), PATTERNS[0]
    mu = entry.initial_modulus
    found = []
    for protocol in (continuous_retraction(strain * size, RAMP, RAMP + WORK), None):
        whole = rests(*hold)
        protocol = protocol or ToolMotion(
            "rests", whole.times, tuple(np.array(whole.advance) * strain * size / OPENING)
        )
        drive = Drive(protocol)
        plate = RigidContact("top", lambda x, drive=drive: size - drive.parameter - x[2], 2e5 * mu, 2e-5)
        body = Problem(
            block((size,) * 3, 0.01),
            {"tissue": Material(entry.law(), 1000 * mu)},
            {"bottom": 0},
            contacts=[plate],
            element="P2/P1",
        )
        t, pressure, total = [0.0], [0.0], plate.pressure(body.u) * plate.measure()

        def watch(b: Problem, at: Any, record: object, t: list = t, p: list = pressure, total: Any = total) -> None:
            t.append(at.t)
            p.append(ngs.Integrate(total, b.mesh) / size**2)

        TimeStepper(body, drive, ErrorControl(tolerance, touch=0.05), 1e-3).run(watch)
        found.append(LoadingHistory(np.array(t), np.zeros(len(t)), np.array(pressure), protocol.times))
    one, many = found
    peaks = many.peaks() / one.pressure.max()
    of = {"kind": "block", "strain": strain, "pattern": "300/300 s", "comparison": "equal work", "ndof": body.fes.ndof}
    of["peak_mmHg"] = float(to_mmHg(one.pressure.max()))
    for measure, value in (
        ("left", one.pressure[-1] / one.pressure.max()),
        ("first peak", peaks[0]),
        ("last peak", peaks[-1]),
        ("mean of peaks", peaks.mean()),
        ("dose", dose(many.curve) / dose(one.curve)),
    ):
        yield of | {"measure": measure, "value": value}


def both(method: str, fine: Callable[[], Values], coarse: Callable[[], Values], common: dict) -> Iterator[dict]:
    """Records: results with fine steps, their difference from coarse steps, and the cost of the fine ones."""
    start = time.process_time()
    try:
        good = list(fine())
        cost = time.process_time() - start
        rough = {key(r): r["value"] for r in coarse()}
    except SolverError as error:
        failed = {"error": None, "converged": False, "reason": str(error)[:120], "kind": "failed", "ndof": None}
        yield {"method": method, "order": 2, **common, **failed, "cpu_s": time.process_time() - start}
        return
    for r in good:
        value, other = float(r["value"]), float(rough.get(key(r), np.nan))
        error = abs(other / value - 1) if np.isfinite(other) and np.isfinite(value) else None
        plain = r | {"value": value if np.isfinite(value) else None, "error": error, "cpu_s": cost / len(good)}
        short = {name: float(f"{v:.5g}") if isinstance(v, float) else v for name, v in plain.items()}
        yield {"method": method, "order": 2, "ndof": 3, **common, **short, "converged": True}


def key(r: dict) -> tuple:
    """Identifying keys of a record."""
    names = ("kind", "rise_s", "mm_s", "pattern", "comparison", "measure", "share", "tau_s")
    strain = "" if r.get("comparison") == "given force" else round(r["strain"], 9)
    return (strain, *(r.get(name) for name in names))


def measure(quick: bool) -> list[dict]:
    """All records; `quick` takes less than a minute."""
    warnings.simplefilter("ignore", RangeWarning)
    steps, found = 8 if quick else STEPS, []
    for name in list(SETS)[1::3] if quick else SETS:
        runs = (lambda n=n, name=name: of_set(name, n, quick) for n in (steps, steps // 2))
        found += both("ngbrain:column", *runs, {"constants": name})
    tolerance = 1e-2 if quick else 1e-3
    runs = (lambda each=each: blocks(each) for each in (tolerance, 10 * tolerance))
    return found + list(both("ngbrain:block", *runs, {"constants": "griffiths2024:white_matter"}))


def chart(records: list[dict], path: str) -> None:
    """Relaxation against measurements; pressures; better protocol by case; recovery time for equal doses."""
    plt, figure, (left, right) = _front.figure(15, 10, 2)
    (relaxing, who), (pressed, recovering) = (halves(figure, axes) for axes in (left, right))
    colours = dict(zip(SETS, ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#8a8a8a", "#c0a030"), strict=True))
    relaxation(relaxing, [r for r in records if r["kind"] == "hold"], colours)
    courses(pressed)
    winners(who, [r for r in records if r["kind"] == "protocol"])
    rows = [r for r in records if r.get("measure", "").startswith("recovery") and r["comparison"] == "equal work"]
    for name, colour in colours.items():
        mine = [r for r in rows if r["constants"] == name and r["pattern"] == "300/300 s"]
        recovering.semilogy(
            [100 * r["strain"] for r in mine], [r["value"] for r in mine], "o-", color=colour, label=SETS[name]
        )
    recovering.axhline(5, color="#999999", ls=":")
    recovering.annotate("length of a rest", (0.02, 5.3), xycoords=("axes fraction", "data"), fontsize=8)
    recovering.set(xlabel="opening / depth (%)", ylabel="recovery time (min); with a shorter one rests win")
    recovering.set_title("Recovery that makes doses of equal work equal, 5 min on and off")
    recovering.legend(fontsize=8)
    for axes in (relaxing, pressed, recovering):
        axes.grid(alpha=0.3, which="both")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def halves(figure: Any, axes: Any) -> tuple[Any, Any]:
    """A panel as two, one above the other."""
    grid = axes.get_subplotspec().subgridspec(2, 1)
    axes.remove()
    return figure.add_subplot(grid[0]), figure.add_subplot(grid[1])


def relaxation(axes: Any, records: list[dict], colours: dict[str, str]) -> None:
    """Remaining share after half an hour against the half-time, along the opening time."""
    for name, colour in colours.items():
        for strain, style in ((STRAINS[0], "--"), (STRAINS[2], "-")):
            mine = [r for r in records if r["constants"] == name and abs(r["strain"] - strain) < 1e-9 and r["value"]]
            left = {r["rise_s"]: r["value"] for r in mine if r["measure"] == "left"}
            half = {r["rise_s"]: r["value"] for r in mine if r["measure"] != "left"}
            label = SETS[name] if style == "-" else None
            axes.semilogx(
                list(half.values()), [left[rise] for rise in half], "o" + style, ms=3, color=colour, label=label
            )
    box = ((HALVED / 1.2, HALVED * 1.2), LEFT - 0.05, LEFT + 0.05)
    axes.fill_between(*box, color="#f2d35b", alpha=0.4, label="measured: 6.6 min (20 % about it), 0.35 (0.05 about it)")
    axes.plot(HALVED, LEFT, "k*", ms=10)
    axes.set(xlabel="half-time (min)", ylabel="left of the peak after half an hour")
    axes.set_title("Opened in 0.5 to 150 s by 10 % (solid) and 0.1 % (dashed) of the depth")
    axes.set_ylim(top=0.68)
    axes.legend(fontsize=8, loc="upper left")


def courses(axes: Any) -> None:
    """White matter, 10 %."""
    warnings.simplefilter("ignore", RangeWarning)
    column = Column(constants("griffiths2024:white_matter").law(), OPENING / 0.1, "planar")
    one, many = continuous_retraction(OPENING, RAMP, RAMP + WORK), rests(*PATTERNS[0])
    steps = staged_retraction(OPENING, RAMP, RAMP + 240 + WORK, 5, 60.0)
    for protocol, label in ((one, "one hold"), (many, "holds with rests"), (steps, "staged")):
        course = column.push(protocol)
        axes.plot(to_minutes(course.t), to_mmHg(course.pressure), label=label, lw=1.3)
    axes.set(xlabel="time (min)", ylabel="pressure (mmHg)", title="White matter, 10 % of the depth in 10 s")
    axes.legend(fontsize=8)


def winners(axes: Any, records: list[dict]) -> None:
    """Ranges of ratios over constants, openings and patterns."""
    rows = [r for r in records if "(min)" not in r["measure"] and not r["measure"].startswith("kept")]
    names = list(dict.fromkeys((r["comparison"].replace("drained, ", ""), r["measure"]) for r in rows))
    for k, (comparison, measure) in enumerate(names):
        for sort, colour, shift in (
            ("griffiths", "#0072B2", -0.2),
            ("miller", "#8a8a8a", 0.0),
            ("drained", "#D55E00", 0.2),
        ):
            wet = sort == "drained"
            mine = [
                r["value"]
                for r in rows
                if r["measure"] == measure
                and r["comparison"] == ("drained, " if wet else "") + comparison
                and (wet or sort in r["constants"])
            ]
            if mine:
                axes.plot([min(mine), max(mine)], [k + shift] * 2, "o-", color=colour, lw=4, ms=4)
    axes.axvline(1, color="k", lw=0.8)
    axes.set_yticks(range(len(names)), [f"{comparison}: {measure}" for comparison, measure in names], fontsize=8)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel="over that of one hold; below 1 rests, stages or force win")
    axes.set_xticks((0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.3), ("0.1", "0.2", "0.3", "0.5", "0.7", "1", "1.3"))
    axes.minorticks_off()
    axes.set_title("Ranges: Griffiths (blue), Miller (grey), with a draining fluid (orange)")
    axes.grid(alpha=0.3, axis="x")


def line(r: dict) -> str:
    """One record as text."""
    if not r["converged"]:
        return f"{r['constants']:<30} failed: {r['reason']}"
    of = " ".join(str(r[name]) for name in ("pattern", "comparison", "rise_s", "mm_s", "share", "tau_s") if name in r)
    value, error = (
        "none" if r[name] is None else format(r[name], form) for name, form in (("value", ".3f"), ("error", ".0e"))
    )
    return f"{r['constants']:<30} {r['kind']:<9} {100 * r['strain']:5.1f} %  {of}: {r['measure']} {value}  ({error})"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
