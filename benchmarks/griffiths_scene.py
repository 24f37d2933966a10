"""Two spatulas as Griffiths, Jayamohan and Budday 2024 moved them: 5.75 mm a side in 150 s, held to 1950 s, with their constants.

On the idealised head and on the MNI152 average, in the fast scenes' coarse elements. `head`: what is left of the peaks of
pressure and of force at the end and when half is, and von Mises stress of each tissue within 20 mm of the walls after the
opening and at the end: mean and percentiles of volume. `steps` "ours" are chosen by their error, "theirs" the 115 of their
files; `error` is of the peak pressure, from "theirs". `column`: the same constants and times at one point of tissue, pressed by
a share of its depth.

As in theirs: incision of 12 by 4 mm, 30 mm deep, program, cortex and white matter. Not as in theirs: our blades press and let
tissue leave, and slide under its surface (they prescribe how the faces move across, and leave them free along), 10 mm wide and
4 mm above the floor; K/μ is 1000 where theirs is 49.67 (ν = .49; `griffiths_locking.py` says what that does); the corpus
callosum has white matter's constants and deep grey matter the cortex's, as our heads do not tell them apart; the ventricles
give way; another head, and a place in it of our own. Their files hold no results, and of their article's stresses by region
only words were at hand (a tube's mean is lower): no number to hold these to.

    python benchmarks/griffiths_scene.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/griffiths_scene.py --chart FILE.png < records.json
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import _front
import numpy as np
from _command import main
from protocols_compared import half_time

from ngbrain.errors import RangeWarning, SolverError
from ngbrain.forward import Control
from ngbrain.materials import constants
from ngbrain.scene import Scene
from ngbrain.surgery import (
    Column,
    LoadingHistory,
    ProtocolRun,
    RetractionModel,
    Sites,
    TissueSample,
    ToolMotion,
    continuous_retraction,
    to_columns,
)
from ngbrain.units import to_mmHg

HEADS = {"idealised": "idealised_fast", "MNI152": "demo_fast"}
A_SIDE, RAMP, END = 5.75e-3, 150.0, 1950.0
CASES = (("idealised", "ours"), ("idealised", "theirs"), ("MNI152", "ours"))
"""Head and steps."""
SOURCES = {"cortex": "cortex", "grey": "cortex", "white": "white_matter"}
"""Tissue → its constants by Griffiths."""
PRESSED = (1e-3, 0.05, 0.1, 0.2)


@dataclass(frozen=True)
class Theirs:
    """The steps of their input file: 100 of 1.5 s, ten of 6, five of 348."""

    touch: float = 1.5
    shortest: float = 0.01

    def propose_step(self, at: Any, travel: Any) -> float:
        """Next step, by the time only."""
        return 1.5 if at.t < RAMP - 1e-6 else 6.0 if at.t < 210.0 - 1e-6 else 348.0

    def check_step(self, body: Any, before: Any, at: Any) -> str:
        """No error control."""
        return ""


def scene(head: str, opening: float) -> Scene:
    """A shipped scene with two spatulas that share the travel."""
    base = Scene.shipped(HEADS[head])
    return replace(
        base,
        title="Griffiths' spatulas",
        protocols=base.protocols[:1],
        tools=(replace(base.tool, kind="two spatulas", travel=opening),),
        time=replace(base.time, ramp=RAMP, end=END, max_step_contact=10.0, max_step_hold=600.0),
    )


def stresses(sites: Sites, sample: TissueSample) -> dict[str, dict[str, float]]:
    """Tissue → mean and percentiles of its von Mises stress (Pa) near the walls, and its volume there (ml)."""
    found = {}
    for k, name in enumerate(sites.names):
        mine = sites.part[sites.near] == k
        if mine.any():
            part = replace(sites, near=sites.near[mine])
            values, volume = sample.von_mises[mine], sites.volume[part.near]
            spread = part.statistics(sample.t, values)
            mean = float(values @ volume / volume.sum())
            found[name] = {"mean": mean, "p50": spread.p50, "p95": spread.p95, "p99": spread.p99}
            found[name]["ml"] = float(1e6 * volume.sum())
    return found


def held(model: RetractionModel, protocol: ToolMotion, control: Control | None) -> dict:
    """Record of one run; `reached_mm` is the opening at which a failing run ends."""
    start = time.process_time()
    run = ProtocolRun(model, protocol, None, control=control)
    record: dict[str, Any] = {"ndof": run.transient.problem.fes.ndof, "a_side_mm": 500 * max(protocol.advance)}
    of: dict[str, dict] = {}
    try:
        for end, name in zip(protocol.times[1:], ("stress_opened_Pa", "stress_end_Pa"), strict=True):
            run.run(until=end)
            of[name] = stresses(run.sampler.sites, run.sampler(end))
    except SolverError as error:
        way = 500 * protocol.value(run.transient.progress.t)
        return record | {"converged": False, "reached_mm": way, "reason": str(error)[:120], "cpu_s": took(start)}
    columns, at = to_columns(run.rows), run.transient.progress
    t, pressure, force = (columns[name] for name in ("t", "pressure", "force"))
    values = {
        "converged": True,
        "cpu_s": took(start),
        "n_steps": at.steps,
        "rejected": at.rejected,
        "newton": at.newton,
        "peak_mmHg": float(to_mmHg(pressure.max())),
        "peak_N": float(force.max()),
        "left": float(pressure[-1] / pressure.max()),
        "left_force": float(force[-1] / force.max()),
        "half_time_min": finite(half_time(LoadingHistory(t, columns["advance"], pressure, protocol.times))),
        "min_det_F": float(columns["min_det_F"].min()),
        "series": {"t_s": t.tolist(), "mmHg": to_mmHg(pressure).tolist(), "N": force.tolist()},
    }
    return record | of | values


def took(start: float) -> float:
    """CPU time (s) since a start."""
    return time.process_time() - start


def finite(value: float) -> float | None:
    """Or nothing."""
    return value if math.isfinite(value) else None


def on_head(head: str, steps: str) -> Iterator[dict]:
    """Records with our steps or theirs; failing runs are repeated up to their last opening."""
    opening = 2 * A_SIDE
    model = RetractionModel.from_scene(scene(head, opening))
    kind = {"kind": "head", "head": head}
    kind |= {"order": model.scene.mesh.order, "tets": model.mesh.ne}
    kind |= {"method": "ngbrain:transient", "steps": steps, "error": None, "depth_mm": 1e3 * model.cleft.depth}
    control: Control | None = Theirs() if steps == "theirs" else None
    found = held(model, continuous_retraction(opening, RAMP, END), control)
    yield kind | found
    if not found["converged"] and control is None:
        less = 0.9 * 2e-3 * found["reached_mm"]
        yield kind | held(model, continuous_retraction(less, RAMP * less / opening, END), control)


def columns() -> Iterator[dict]:
    """One point of each tissue."""
    for name in sorted(set(SOURCES.values())):
        law = constants(f"griffiths2024:{name}").law()
        for share in PRESSED:
            start = time.process_time()
            fine, coarse = (
                Column(law, A_SIDE / share, "planar", steps).push(continuous_retraction(A_SIDE, RAMP, END))
                for steps in (32, 16)
            )
            left, rough = (c.pressure[-1] / c.pressure.max() for c in (fine, coarse))
            of = {"kind": "column", "method": "ngbrain:column", "tissue": name, "strain": share, "order": 2, "ndof": 3}
            record = of | {"left": float(left), "error": float(abs(rough / left - 1)), "converged": True}
            yield record | {"peak_mmHg": float(to_mmHg(fine.pressure.max())), "cpu_s": took(start)}


def measure(quick: bool) -> list[dict]:
    """All records; `quick` is the column and the idealised head with our steps."""
    warnings.simplefilter("ignore", RangeWarning)
    records = list(columns())
    for case in CASES[:1] if quick else CASES:
        records += on_head(*case)
    return compared(records)


def compared(records: list[dict]) -> list[dict]:
    """Records with errors relative to their steps and the ratio of times."""
    for r in (r for r in records if r["kind"] == "head" and r["converged"] and r["steps"] == "ours"):
        for fine in (s for s in records if alike(r, s) and s["steps"] == "theirs" and s["converged"]):
            r["error"] = abs(r["peak_mmHg"] / fine["peak_mmHg"] - 1)
            r["left_error"] = abs(r["left"] / fine["left"] - 1)
            r["cpu_ratio"] = fine["cpu_s"] / r["cpu_s"]
    return records


def alike(r: dict, s: dict) -> bool:
    """Whether two runs of a head differ in their steps only."""
    return s["kind"] == "head" and all(r[k] == s[k] for k in ("head", "a_side_mm"))


def chart(records: list[dict], path: str) -> None:
    """Remaining force over time, and stress by tissue."""
    plt, figure, (over, left, tissues) = _front.figure(16, 5.4, 3, width_ratios=(1.1, 1.1, 1.2))
    heads = [r for r in records if r["kind"] == "head" and r["converged"]]
    colours = {"idealised": "#0072B2", "MNI152": "#D55E00"}
    for r in heads:
        look = {"color": colours[r["head"]], "linestyle": ":" if r["steps"] == "theirs" else "-", "lw": 1.8}
        t, p = np.array(r["series"]["t_s"]), np.array(r["series"]["mmHg"])
        mark = {"marker": "o", "ms": 3} if r["steps"] == "ours" else {}
        label = f"{r['head']}, {r['n_steps']} steps" + (" (theirs)" if r["steps"] == "theirs" else "")
        over.plot(t / 60, p, label=label, **look, **mark)
        if r["steps"] == "ours":
            held_, top = t >= RAMP, p.max()
            left.plot((t[held_] - RAMP) / 60, p[held_] / top, label=label, **look, **mark)
    for r in (r for r in records if r["kind"] == "column" and r["strain"] in PRESSED[2:]):
        shade = {"cortex": "#009E73", "white_matter": "#CC79A7"}[r["tissue"]]
        text = f"one point of {r['tissue'].replace('_', ' ')}, {r['strain']:.0%}"
        left.plot((END - RAMP) / 60, r["left"], "D" if r["strain"] < 0.15 else "s", color=shade, label=text)
    left.axhline(0.35, color="#999999", lw=0.8, ls="--")
    left.annotate("35 %, Awasthi 2020 (dogs)", (1, 0.36), fontsize=8, color="#666666")
    over.set(
        xlabel="time (min)", ylabel="mean pressure on the walls (mmHg)", title="5.75 mm a side in 150 s, then held"
    )
    left.set(xlabel="time held (min)", ylabel="pressure over its peak", ylim=(0, 1.05), title="What is left")
    for axes in (over, left):
        axes.legend(fontsize=7, frameon=False, loc="lower right" if axes is over else "lower left")
        axes.grid(alpha=0.25, lw=0.6)
    by_tissue(tissues, [r for r in heads if r["steps"] == "ours"], colours)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def by_tissue(axes: Any, heads: list[dict], colours: dict[str, str]) -> None:
    """Median to 95 % of the von Mises stress, its mean as a point, after the opening and (pale) at the end."""
    names = []
    for r in heads:
        for tissue in r["stress_opened_Pa"]:
            k = len(names)
            names.append(f"{r['head']}:\n{tissue}")
            for name, shift, alpha in (("stress_opened_Pa", -0.17, 1.0), ("stress_end_Pa", 0.17, 0.4)):
                s = {key: value / 1e3 for key, value in r[name][tissue].items()}
                axes.plot(
                    [s["p50"], s["p95"]],
                    [k + shift] * 2,
                    color=colours[r["head"]],
                    lw=7,
                    alpha=alpha,
                    solid_capstyle="butt",
                )
                axes.plot(s["mean"], k + shift, "o", color="white", mec="#333333", ms=5)
                axes.plot(s["p99"], k + shift, "|", color=colours[r["head"]], ms=10, alpha=alpha)
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel="von Mises stress within 20 mm (kPa)")
    axes.set_title("Median to 95 % (bar), mean (o), 99 % (|)\nafter the opening, and pale at the end", fontsize=10)
    axes.grid(alpha=0.25, lw=0.6, axis="x")


def line(r: dict) -> str:
    """One record as text."""
    if r["kind"] == "column":
        return f"column {r['tissue']:<13} {r['strain']:5.1%}  peak {r['peak_mmHg']:7.2f} mmHg  left {r['left']:.3f}"
    what = f"{r['head']:<10} {r['steps']:<7} {r['ndof']:6d} unknowns"
    what += f" {r['a_side_mm']:.2f} mm a side"
    if not r["converged"]:
        return f"{what}  failed at {r['reached_mm']:.2f} mm: {r['reason']}"
    half = "never" if r["half_time_min"] is None else f"after {r['half_time_min']:.1f} min"
    text = (
        f"{what}  {r['peak_mmHg']:.1f} mmHg, {r['peak_N']:.2f} N; left {r['left']:.3f}, of force {r['left_force']:.3f}"
    )
    text += (
        f"; half {half}; {r['n_steps']} steps, {r['rejected']} rejected, {r['cpu_s']:.0f} s, det F {r['min_det_F']:.2f}"
    )
    for name in ("stress_opened_Pa", "stress_end_Pa"):
        for tissue, s in r[name].items():
            values = ", ".join(f"{k} {s[k]:.0f}" for k in ("mean", "p50", "p95", "p99"))
            text += f"\n    {name} {tissue:<8} {s['ml']:.1f} ml: {values}"
    return text


if __name__ == "__main__":
    main(__doc__ or "", measure, chart, line)
