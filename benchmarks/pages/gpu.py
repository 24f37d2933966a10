"""Tables of the page on GPUs."""

from _pages import records
from _tables import MISSING, Record, bullets, count, number, percent, seconds, spread, table

PROBLEMS = {
    "elasticity": ("elasticity, P2", "cg"), "mixed": ("mixed, K/μ = 1000", "minres"), "waves": ("waves, one wavelength", "tfqmr"),
}  # fmt: skip
"""What a problem is called, and its iterative method."""
THREADS = (16, 1)
LARGE = 50_000
"""Unknowns from which on factors are compared."""


def _of(problem: str, method: str) -> dict[int, Record]:
    return {
        r["ndof"]: r
        for r in records("gpu")
        if r["problem"] == problem and r["method"] == f"ngbrain:{problem}: {method}"
    }


def _time(record: Record | None) -> str:
    if record is None:
        return MISSING
    if record.get("setup_s") is None or record.get("solve_s") is None:
        return record["reason"] or MISSING
    reason = f" ({record['reason']})" if record["reason"] else ""
    return f"{number(record['setup_s'])} + {number(record['solve_s'])}{reason}"


def solvers() -> str:
    rows = []
    for problem, (shown, krylov) in PROBLEMS.items():
        methods = [
            "cudss, device", f"{krylov}, device", *(f"{krylov}, processor, threads {n}" for n in THREADS),
            *(f"direct, processor, threads {n}" for n in THREADS),
        ]  # fmt: skip
        by = [_of(problem, method) for method in methods]
        for ndof in sorted(by[0]):
            rows.append([f"{shown}, {krylov.upper()}", count(ndof), *(_time(of.get(ndof)) for of in by)])
    both = [f"{kind}, {n} thread{'s' if n > 1 else ''}" for kind in ("Krylov", "direct") for n in THREADS]
    titles = ("cuDSS", "Krylov, GPU", *both)
    return table(("problem", "unknowns", *titles), rows)


def behind() -> str:
    slower = []
    for problem, (shown, krylov) in PROBLEMS.items():
        cudss, direct = _of(problem, "cudss, device"), _of(problem, "direct, processor, threads 16")
        device, processor = _of(problem, f"{krylov}, device"), _of(problem, f"{krylov}, processor, threads 16")
        for what, mine, other in (("cuDSS", cudss, direct), (krylov.upper(), device, processor)):
            for ndof in sorted(mine):
                if (
                    ndof in other
                    and _both(mine[ndof])
                    and _both(other[ndof])
                    and _both(mine[ndof]) > _both(other[ndof])
                ):
                    slower.append(f"{what} of {shown} with {count(ndof)} unknowns ({seconds(_both(mine[ndof]))} against"
                                  f" {seconds(_both(other[ndof]))})")  # fmt: skip
    single = spread(
        r["solve_s"] / _of("elasticity", "cg, device")[ndof]["solve_s"]
        for ndof, r in _of("elasticity", "cg in single precision, refined, device").items() if r["solve_s"]
    )  # fmt: skip
    return bullets([
        f"The GPU is slower than 16 threads, set-up and one solve: {'; '.join(slower)}.",
        f"CG in single precision, refined, takes {single} times the time of CG to solve.",
    ])  # fmt: skip


def _both(record: Record) -> float:
    return (record.get("setup_s") or 0) + (record.get("solve_s") or 0) if record["converged"] else 0


def conclusion() -> str:
    texts = []
    for problem, (shown, krylov) in PROBLEMS.items():
        device, processor = _of(problem, f"{krylov}, device"), _of(problem, f"{krylov}, processor, threads 16")
        largest = max(n for n in device if n in processor and device[n].get("solve_s") and processor[n].get("solve_s"))
        gain = number(processor[largest]["solve_s"] / device[largest]["solve_s"])
        texts.append(
            f"{shown} with {count(largest)} unknowns {gain} times quicker ({seconds(device[largest]['solve_s'])})"
        )
    factor = []
    for problem in PROBLEMS:
        cudss, direct = _of(problem, "cudss, device"), _of(problem, "direct, processor, threads 16")
        both = [n for n in cudss if n > LARGE and n in direct and direct[n].get("setup_s")]
        factor += [direct[n]["setup_s"] / cudss[n]["setup_s"] for n in both]
    return (
        f"Iterative solves on the GPU beside 16 threads: {'; '.join(texts)}. cuDSS factorises systems of more than {count(LARGE)}"
        f" unknowns {spread(factor)} times as fast as 16 threads."
    )


def memory() -> str:
    found = {r["method"].rpartition(" ")[2]: r["bytes_per_s"] / 1e9 for r in records("gpu") if r["problem"] == "memory"}
    device, processor = count(found["device"]), number(found["processor"])
    return f"Measured bandwidth of memory: GPU {device} GB/s, one thread of the processor {processor}."


def application() -> str:
    rows = []
    for order in sorted({r["order"] for r in records("gpu") if r["problem"].startswith("stiffness")}):
        of = {r["method"].partition(": ")[2]: r for r in records("gpu") if r["problem"] == f"stiffness {order}"}
        cells = [
            f"{number(1e3 * of[m]['solve_s'])} ms" if of.get(m) and of[m].get("solve_s") else MISSING
            for m in ("assembled, device", "matrix-free, device", "assembled, processor, threads 1")
        ]
        rows.append([str(order), count(next(iter(of.values()))["ndof"]), *cells])
    return table(("order", "unknowns", "assembled, GPU", "matrix-free, GPU", "assembled, one thread"), rows)


def inversions() -> str:
    rows = []
    for r in records("gpu"):
        if r["problem"].startswith("inversion"):
            phases = [seconds(r["phases"][phase]) for phase in ("assembly", "factor", "solves", "rest")]
            rows.append([
                r["problem"].removeprefix("inversion "), count(r["ndof"]), str(r["factorisations"]), count(r["solves"]),
                r["method"].rpartition(": ")[2], seconds(r["solve_s"], 3), *phases, percent(r["error"], 3),
                f"{r['difference']:.0e}" if r["difference"] else MISSING,
            ])  # fmt: skip
    titles = (
        "inversion", "complex unknowns", "factors", "solves", "where", "all", "assembly", "factors", "solves", "rest",
        "error of G*", "off the processor's fields",
    )  # fmt: skip
    return table(titles, rows)
