"""Error against time on Cook's membrane, nearly incompressible: uniform meshes for all, refined at corners for two.

48 by 44 and 16 mm, plane strain, clamped on the left, a dead load of 6.25 N/mm up on the right; unsplit Neo-Hooke of
μ = 80.194 N/mm² with p ln J - p²/2K, K/μ = 5000. Asked is how far the corner at (48, 60) rises: 6.93485 ± 0.0005 mm.
Stresses are singular in corners: on uniform meshes every order converges like about h^1.3, and only refinement there lets
an order pay off; too much of it is in vain, since elements in the clamped corner invert. Peers take 5 load steps, ours one
and more where it fails. One thread; the time counts mesh, compilation, set-up and checks, imports not. All solve to 10⁻⁸.

    python benchmarks/statics_cook.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/statics_cook.py --chart FILE.png < records.json
"""

from __future__ import annotations

from _statics import Benchmark, Method

REFINED = ((4, 2), (4, 4), (8, 6), (16, 8))

BENCHMARK = Benchmark(
    about=__doc__,
    case="cook",
    reference=6.93485,
    alike=2e-3,
    title="Cook's membrane, K/μ = 5000; n + k: refined k times at corners",
    methods=(
        Method("ngbrain", "auto", (4, 8, 16, 32, 64), 3),
        Method("ngbrain", "P3/P2", (4, 8, 16, 32), 3),
        Method("ngbrain", "P4/L2(2)", (2, 4, 8, 16), 3),
        Method("ngbrain", "P2", (4, 8, 16), 1),
        Method("ngbrain", "P2/P1", REFINED, 3),
        Method("ngbrain", "P4/L2(2)", (*REFINED, (16, 16)), 3),
        Method("ngbrain", "Q2/L2(1)", (4, 8, 16, 32), 3),
        Method("ngsolve", "P2/P1", (8, 16, 32, 64), 2),
        Method("ngsolve", "P4/L2(2)", (4, 8, 16), 2),
        Method("ngsolve", "P4/L2(2)", (*REFINED, (16, 16)), 2),
        Method("ngsolve", "P2", (4, 8, 16)),
        Method("dolfinx", "P2/P1", (8, 16, 32, 64), 2),
        Method("dolfinx", "P3/P2", (8, 16, 32), 1),
        Method("dolfinx", "P4/L2(2)", (4, 8, 16), 2),
        Method("dolfinx", "P2", (4, 8, 16), 1),
        Method("felupe", "P2/P1", (8, 16, 32), 1),
        Method("felupe", "Q2/L2(1)", (8, 16, 32), 1),
        Method("felupe", "P2", (4, 8, 16)),
        Method("skfem", "P2/P1", (8, 16, 32), 1),
        Method("skfem", "P4/L2(2)", (4, 8)),
    ),
    compared=(
        "ngbrain:auto",
        "ngbrain:P3/P2",
        "ngbrain:P4/L2(2)",
        "ngbrain:P2/P1 graded",
        "ngbrain:P4/L2(2) graded",
        "NGSolve P4/L2(2) graded",
        "NGSolve P4/L2(2)",
        "dolfinx P3/P2",
        "dolfinx P4/L2(2)",
        "FElupe Q2/L2(1)",
    ),
)

if __name__ == "__main__":
    BENCHMARK.main()
