"""Published cases of MatNLI inverted by one call without a given start, weight or regulariser.

Six of its nine cases and the transversely isotropic one with two loads (`ngbrain.inverse.phantoms.benchmark`), made anew on
their own
grids, with 1 % noise on every point and without; in the grids' own elements, and in ours, in which even the truth's waves are off
the data by `mismatch` (measured where there is no noise). `error` is that of the first field (youngs, storage or mu), the others
stand beside it. The published method (BFGS from the published start, no noise) is quoted where its result is known: not measured.

    python benchmarks/inversion_cases.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_cases.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time

import numpy as np
from _command import main, sweep
from _front import figure

from ngbrain import parallel
from ngbrain.errors import NgbrainError
from ngbrain.inverse import PHANTOMS, Phantom, discretise, invert, original_discretisation

Record = dict
QUOTED = {
    "CE-G": {"youngs": 0.0760},
    "CE-B": {"youngs": 0.451},
    "CV-G": {"storage": 0.00045, "loss": 0.00465},
    "CV-B": {"storage": 0.153, "loss": 1.65},
    "NE-G": {"youngs": 0.0537},
    "NV-G": {"storage": 0.0064, "loss": 0.0624},
    "TI": {"mu": 0.0307, "zeta": 0.105, "phi": 0.129},
}
"""Relative errors of MatNLI's BFGS without noise after 200 to 500 s."""
NOISES = (0.0, 0.01)
SAME, OURS = "ngbrain:invert", "ngbrain:invert, our elements"
ELEMENTS = {SAME: original_discretisation, OURS: discretise}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """One record for each case and noise."""
    names = ("CV-G",) if quick else tuple(PHANTOMS)
    nodes = 25 if quick else None
    every = {
        f"{name}, {method}, noise {noise:g}": (name, noise, nodes, method)
        for name in names
        for method in ELEMENTS
        for noise in NOISES
    }
    return sweep(record, every, executor)


def record(name: str, noise: float, nodes: int | None, method: str) -> Record:
    """One inversion; a failure is a record too."""
    measured = Phantom.from_name(name, nodes).simulate_measurements(noise)
    data = measured.data()
    found: Record = {
        "method": method,
        "order": 1,
        "case": name,
        "noise": noise,
        "converged": False,
        "error": None,
    }
    begun = time.process_time()
    try:
        inversion = invert(data, ELEMENTS[method](data), noise=noise, uniform=False)
    except NgbrainError as error:
        return found | {"cpu_s": time.process_time() - begun, "ndof": 0, "reason": str(error)}
    errors = {key: value["relative_l2_error"] for key, value in inversion.answers.items()}
    last = inversion.starts[-1]
    return found | {
        "cpu_s": time.process_time() - begun,
        "ndof": inversion.model["n_unknowns"],
        "error": next(iter(errors.values())),
        "errors": errors,
        "mismatch": inversion.model.get("mismatch_at_truth") if method == OURS and not noise else None,
        "converged": last.converged,
        "regulariser": inversion.regulariser,
        "misfit_over_expected": last.misfit / last.expected,
        "rounds": sum(len(row.history) for row in inversion.starts),
    }


def chart(records: list[Record], path: str) -> None:
    """Errors by case."""
    cases = list(dict.fromkeys(record["case"] for record in records))
    _, fig, ax = figure(8, 5)
    ways = [(SAME, "o", "the data's elements"), (OURS, "s", "ours")]
    for k, (noise, colour) in enumerate(((0.0, "#009E73"), (0.01, "#0072B2"))):
        for j, (method, marker, elements) in enumerate(ways):
            ax.plot([], [], marker, color=colour, label=f"{elements}, {f'{noise:.0%} noise' if noise else 'no noise'}")
            for r in (r for r in records if (r["method"], r["noise"]) == (method, noise)):
                errors = list(r.get("errors", {}).values()) or [np.nan]
                at = cases.index(r["case"]) + 0.24 * (k - 0.5) + 0.1 * (j - 0.5)
                ax.plot([at] * len(errors), 100 * np.array(errors), marker, color=colour, ms=5)
    label = "MatNLI without noise (published code, BFGS)"
    for i, case in enumerate(cases):
        if case in QUOTED:
            values = 100 * np.array(list(QUOTED[case].values()))
            ax.plot([i] * len(values), values, "x", color="#D55E00", label=label)
            label = "_"
    ax.set_yscale("log")
    ax.set_xticks(range(len(cases)), cases, rotation=30, ha="right")
    ax.set_ylabel("relative error of each field, %")
    ax.set_title("MatNLI's cases: one call, no settings")
    ax.grid(True, axis="y", alpha=0.3)
    fig.legend(loc="outside lower center", ncols=3)
    fig.savefig(path, dpi=130, bbox_inches="tight")


def line(record: Record) -> str:
    """One record as text."""
    errors = ", ".join(f"{name} {100 * value:.2f} %" for name, value in record.get("errors", {}).items())
    start = f"{record['case']:<6} noise {100 * record['noise']:.0f} %"
    off = f", {record['mismatch']:.2%} of mismatch" if record.get("mismatch") else ""
    return f"{start}: {errors}, {record['cpu_s']:.0f} s, {record.get('regulariser', '')}{off} ({record['method']})"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
