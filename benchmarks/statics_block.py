"""Robustness and cost for each unknown: a cube between bonded plates, pressed by 20 % in one load step.

0.1 m, Neo-Hookean, K/μ = 100; asked is the force on the top. Its bonded edges are singular, so that every code and every
order converges like about h^0.6: this measures who gets there at all, why others do not, and what an unknown costs, not
which order pays off (that is `statics_smooth`). Reference by extrapolation, -8.98 ± 0.03 N: errors below 0.3 % say nothing.
One thread; the time counts mesh, compilation, set-up and every check, imports and dolfinx's C compiler not. Peers take
undamped Newton steps; ours cuts the load step where that fails. All solve to 10⁻⁸.

    python benchmarks/statics_block.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/statics_block.py --chart FILE.png < records.json
"""

from __future__ import annotations

from _statics import Benchmark, Method

BENCHMARK = Benchmark(
    about=__doc__,
    case="block",
    reference=-8.98,
    alike=4.5e-2,
    title="A cube between bonded plates, pressed by 20 % in one step, K/μ = 100",
    methods=(
        Method("ngbrain", "auto", (2, 4, 6, 8, 12), 3),
        Method("ngbrain", "P3/P2", (2, 4), 1),
        Method("ngbrain", "P4/L2(2)", (2, 3, 4), 2),
        Method("ngbrain", "Q2", (2, 4, 6, 8), 3),
        Method("ngbrain", "Q2/Q1", (2, 4, 6, 8), 2),
        Method("ngbrain", "Q2/L2(1)", (2, 4, 6, 8, 12), 3),
        Method("ngsolve", "P2/P1", (2, 4, 6, 8), 2),
        Method("ngsolve", "P4/L2(2)", (2, 3, 4), 2),
        Method("ngsolve", "Q2/L2(1)", (2, 4, 6, 8), 2),
        Method("ngsolve", "Q2", (2, 4, 6), 3),
        Method("dolfinx", "P2/P1", (2, 4, 6, 8, 12), 2),
        Method("dolfinx", "P4/L2(2)", (2, 3), 1),
        Method("dolfinx", "Q2/Q1", (2, 4, 6, 8), 2),
        Method("dolfinx", "Q2", (2, 4, 6, 8), 3),
        Method("felupe", "P2/P1", (2, 4, 6), 2),
        Method("felupe", "Q2/L2(1)", (2, 4, 6), 2),
        Method("felupe", "Q2", (2, 4, 6)),
        Method("skfem", "P2/P1", (2, 4), 1),
        Method("skfem", "Q2/Q1", (2, 4)),
        Method("skfem", "Q2", (4, 6)),
    ),
    compared=(
        "ngbrain:auto",
        "ngbrain:P4/L2(2)",
        "ngbrain:Q2/L2(1)",
        "ngbrain:Q2/Q1",
        "NGSolve P2/P1",
        "NGSolve Q2/L2(1)",
        "dolfinx P2/P1",
        "dolfinx Q2/Q1",
        "FElupe P2/P1",
        "FElupe Q2/L2(1)",
        "scikit-fem P2/P1",
    ),
)

if __name__ == "__main__":
    BENCHMARK.main()
