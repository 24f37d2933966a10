"""Error against time where solutions are smooth: forms and orders of ours beside four other solvers.

A cube of 0.1 m, Neo-Hookean, K/μ = 100, its bottom clamped and its sides on rollers; the top is moved by 10 mm at most, as
cos(πx/L) cos(πy/L), and does not slide. Its edges are no singularities, so orders pay off. Asked is the force that is
conjugate to the motion; reference -2.250171 ± 10⁻⁶ N, by P4 and Q5 on finer meshes. One thread; the time counts mesh,
compilation, set-up and every check, imports and dolfinx's C compiler not. One load step; all solve to 10⁻⁸.

    python benchmarks/statics_smooth.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/statics_smooth.py --chart FILE.png < records.json
    python benchmarks/statics_smooth.py --compare < records.json      seconds to 0.02 %, and ours against two peers
"""

from __future__ import annotations

import json
import sys

from _statics import Benchmark, Method, percent, time_to

ASKED = 2e-4
OURS, PLAIN, DOLFINX = "ngbrain:auto", "NGSolve P4/L2(2)", "dolfinx P2/P1"
SLOWER, FASTER = 1.2, 20.0
"""What ours may take of plain NGSolve's time, and how much less than dolfinx's it is to take."""

BENCHMARK = Benchmark(
    about=__doc__,
    case="smooth",
    reference=-2.250171,
    alike=ASKED,
    title="Smooth compression of a cube between rollers, K/μ = 100",
    methods=(
        Method("ngbrain", "auto", (2, 3, 4, 5), 3),
        Method("ngbrain", "P4/L2(2)", (2, 3)),
        Method("ngbrain", "P3/P2", (2, 3, 4, 6), 3),
        Method("ngbrain", "P2/P1", (4, 6, 8, 10), 2),
        Method("ngbrain", "P3", (2, 3, 4), 1),
        Method("ngbrain", "Q2/L2(1)", (2, 4, 6, 8), 3),
        Method("ngbrain", "Q2/Q1", (2, 4, 6)),
        Method("ngbrain", "Q4/L2(3)", (1, 2, 3), 2),
        Method("ngsolve", "P4/L2(2)", (2, 3, 4), 2),
        Method("ngsolve", "P2/P1", (4, 6, 8), 2),
        Method("ngsolve", "P3", (2, 3, 4)),
        Method("ngsolve", "Q4/L2(3)", (1, 2), 1),
        Method("dolfinx", "P2/P1", (4, 6, 8, 11), 2),
        Method("dolfinx", "P3/P2", (2, 3, 4)),
        Method("dolfinx", "P4/L2(2)", (2, 3, 4), 2),
        Method("dolfinx", "Q2/Q1", (2, 4, 6), 2),
        Method("felupe", "P2/P1", (4, 6, 8), 1),
        Method("felupe", "Q2/L2(1)", (2, 4, 6)),
        Method("skfem", "P2/P1", (4, 6), 1),
        Method("skfem", "Q2/Q1", (2, 4)),
    ),
    compared=(
        OURS,
        "ngbrain:P3/P2",
        "ngbrain:P2/P1",
        "ngbrain:Q2/L2(1)",
        PLAIN,
        DOLFINX,
        "dolfinx P3/P2",
        "dolfinx P4/L2(2)",
        "dolfinx Q2/Q1",
        "FElupe P2/P1",
    ),
)


def compare(records: list[dict]) -> str:
    """Seconds to the asked error by method, and whether ours is as fast as it is to be."""
    times = {
        m: time_to((r for r in records if r["method"] == m), ASKED) for m in dict.fromkeys(r["method"] for r in records)
    }
    lines = [f"CPU seconds to {percent(ASKED)}, one thread"]
    lines += [f"{m:<24} {'-' if t is None else f'{t:8.3f}':>8}" for m, t in times.items()]
    ours, plain, other = (times.get(m) for m in (OURS, PLAIN, DOLFINX))
    if ours and plain:
        lines.append(f"{OURS} / {PLAIN}: {ours / plain:.2f} (at most {SLOWER:g})")
    if ours and other:
        lines.append(f"{DOLFINX} / {OURS}: {other / ours:.1f} (at least {FASTER:g})")
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1:] == ["--compare"]:
        print(compare(json.loads(sys.stdin.read().strip().splitlines()[-1])))
    else:
        BENCHMARK.main()
