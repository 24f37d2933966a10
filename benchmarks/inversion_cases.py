"""Published cases of MatNLI inverted by one call that is told nothing: neither start nor weight nor regulariser.

Six of its nine cases and the transversely isotropic one with two loads (`ngbrain.inverse.phantoms`), made anew on their own
grids, with 1 % noise on every point and without. `error` is that of the first field (youngs, storage or mu), the others stand
beside it. The published method (BFGS from the published start, no noise) is quoted where its result is known: not measured here.

    python benchmarks/inversion_cases.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_cases.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time

import numpy as np
from _command import main
from _front import figure

from ngbrain.errors import NgbrainError
from ngbrain.inverse.invert import invert
from ngbrain.inverse.phantoms import PHANTOMS, Phantom

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


def measure(quick: bool) -> list[Record]:
    """One record for each case and noise."""
    names = ("CV-G",) if quick else tuple(PHANTOMS)
    return [record(name, noise, 25 if quick else None) for name in names for noise in NOISES]


def record(name: str, noise: float, nodes: int | None) -> Record:
    """One inversion; a failure is a record too."""
    measured = Phantom.named(name, nodes).measured(noise)
    data = measured.data()
    found: Record = {
        "method": "ngbrain:invert",
        "order": 1,
        "case": name,
        "noise": noise,
        "converged": False,
        "error": None,
    }
    begun = time.process_time()
    try:
        inversion = invert(data, noise=noise, uniform=False)
    except NgbrainError as error:
        return found | {"cpu_s": time.process_time() - begun, "ndof": 0, "reason": str(error)}
    errors = {key: value["relative_l2_error"] for key, value in inversion.answers.items()}
    last = inversion.rows[-1]
    return found | {
        "cpu_s": time.process_time() - begun,
        "ndof": inversion.model["n_unknowns"],
        "error": next(iter(errors.values())),
        "errors": errors,
        "converged": last.converged,
        "regulariser": inversion.regulariser,
        "misfit_over_expected": last.misfit / last.expected,
        "rounds": sum(len(row.history) for row in inversion.rows),
    }


def chart(records: list[Record], path: str) -> None:
    """Errors by case."""
    cases = list(dict.fromkeys(record["case"] for record in records))
    _, fig, ax = figure(8, 5)
    for noise, colour, label in ((0.0, "#009E73", "without noise"), (0.01, "#0072B2", "1 % noise")):
        for i, case in enumerate(cases):
            for record in (r for r in records if r["case"] == case and r["noise"] == noise):
                errors = list(record.get("errors", {}).values()) or [np.nan]
                ax.plot(
                    [i + (0.12 if noise else -0.12)] * len(errors),
                    100 * np.array(errors),
                    "o",
                    color=colour,
                    label=label,
                )
                label = "_"
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
    """For people."""
    errors = ", ".join(f"{name} {100 * value:.2f} %" for name, value in record.get("errors", {}).items())
    start = f"{record['case']:<6} noise {100 * record['noise']:.0f} %"
    return f"{start}: {errors}, {record['cpu_s']:.0f} s, {record.get('regulariser', '')}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
