"""Error against time of inversions of waves, at 0, 1, 2 and 5 % noise: what is best on clean data is not so on measured ones.

A published case (CV-G, see `ngbrain.inverse.phantoms.benchmark`): a stiff spot in a viscoelastic square at 50 Hz, 51 × 51
points, data and
inversion in the same discretisation. `error` is ‖G - truth‖/‖truth‖ of the complex modulus over the points, of |G| for local
frequency, which knows no loss. All start from the published uniform start except direct inversion and local frequency, which
need none, and Gauss-Newton "from waves". BFGS "as published" has no regulariser: it is shown at several times. One thread;
imports, mesh and forms are not counted. A method that has not settled after its time has failed.

    python benchmarks/inversion_noise.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_noise.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import _command
import numpy as np
from _front import STRONG, figure, front

from ngbrain.errors import NgbrainError
from ngbrain.inverse import (
    GaussNewton,
    OptimisationResult,
    Phantom,
    PhantomData,
    PhantomInversion,
    bfgs,
    helmholtz,
    l_bfgs,
    levenberg_marquardt,
    local_frequency,
    newton_cg,
)

Record = dict
CASE = "CV-G"
NOISES = (0.0, 0.01, 0.02, 0.05)
LONG, SHORT = 90.0, 4.0
"""CPU seconds after which a descent is stopped."""
PUBLISHED = "MatNLI BFGS"
WATCHED = (10, 30, 100, 300)
"""Iterations at which errors are recorded."""


class OutOfTime(Exception):
    """The time limit of a descent is reached."""


def measure(quick: bool) -> list[Record]:
    """One record for each method and noise level; several for the published method."""
    records: list[Record] = []
    for noise in NOISES[:2] if quick else NOISES:
        measured = Phantom.from_name(CASE, 17 if quick else None).simulate_measurements(noise)
        for method, way in WAYS.items():
            records.append(record(measured, method, way))
        records += published(measured, SHORT if quick else LONG)
        for method, start, descend in DESCENTS:
            records.append(descended(measured, method, start, descend, SHORT if quick else LONG))
    return records


def blank(measured: PhantomData, method: str, start: str) -> Record:
    """Entries common to all records."""
    ndof = len(measured.truth) * len(measured.points)
    fixed = {"method": method, "order": 1, "ndof": ndof, "error": None, "cpu_s": None, "converged": False}
    return fixed | {"noise": measured.noise, "case": CASE, "seed": 0, "start": start, "n": measured.phantom.nodes}


def judged(measured: PhantomData, fields: dict[str, np.ndarray]) -> Record:
    """Errors of storage and loss, and of both together."""
    truth = measured.truth["storage"] + 1j * measured.truth["loss"]
    found = fields["storage"] + 1j * fields["loss"]
    return {"error": float(np.linalg.norm(found - truth) / np.linalg.norm(truth)), **measured.errors(fields)}


def record(measured: PhantomData, method: str, way: Callable) -> Record:
    """Record of a method without an initial guess."""
    begun = time.process_time()
    shear = way(measured.data())
    cpu_s, truth = time.process_time() - begun, measured.truth["storage"] + 1j * measured.truth["loss"]
    if way is local_frequency:
        shear, truth = np.abs(shear), np.abs(truth)
    there = np.isfinite(shear)
    error = float(np.linalg.norm((shear - truth)[there]) / np.linalg.norm(truth[there]))
    return blank(measured, method, "none") | {"error": error, "cpu_s": cpu_s, "converged": error < 1}


def published(measured: PhantomData, limit: float) -> Iterator[Record]:
    """BFGS without a regulariser, at several iterations and at its end; an error above 1 counts as a failure."""
    begun, last = time.process_time(), None
    for iterate in measured.published_iterations():
        last, cpu_s = iterate, time.process_time() - begun
        if iterate.number in WATCHED or cpu_s > limit:
            yield _published(measured, iterate, cpu_s)
        if cpu_s > limit:
            return
    if last is not None and last.number not in WATCHED:
        yield _published(measured, last, time.process_time() - begun)


def _published(measured: PhantomData, iterate, cpu_s: float) -> Record:  # type: ignore[no-untyped-def]
    found = judged(measured, iterate.fields)
    known = {"cpu_s": cpu_s, "converged": found["error"] < 1, "iterations": iterate.number}
    known |= {} if known["converged"] else {"reason": "off by more than the modulus"}
    return blank(measured, PUBLISHED, "uniform") | found | known


def descended(measured: PhantomData, method: str, start: str, descend: Callable, limit: float) -> Record:
    """Record of a descent with a regulariser and evidence weights."""
    inversion, begun = measured.inversion(), time.process_time()
    steps: list[object] = []

    def callback(iteration: object) -> None:
        steps.append(iteration)
        if time.process_time() - begun > limit:
            raise OutOfTime

    made = blank(measured, method, start)
    try:
        found: OptimisationResult = descend(inversion, callback)
    except (OutOfTime, NgbrainError) as error:
        reason = "out of time" if isinstance(error, OutOfTime) else str(error)
        return made | {"cpu_s": time.process_time() - begun, "reason": reason, "iterations": len(steps)}
    known = {"cpu_s": time.process_time() - begun, "converged": found.converged, "iterations": len(found.history)}
    return made | judged(measured, inversion.fields(found.x)) | known | {"misfit": found.level.ratio}


def gauss_newton(inversion: PhantomInversion, callback: Callable) -> OptimisationResult:
    """Descent from the uniform initial guess."""
    return GaussNewton(inversion.reduced, callback=callback).descend(inversion.start)


def from_waves(inversion: PhantomInversion, callback: Callable) -> OptimisationResult:
    """Inversion from the measured waves."""
    return GaussNewton(inversion.reduced, callback=callback).from_waves(inversion.start, inversion.waves)


def both(inversion: PhantomInversion, callback: Callable) -> OptimisationResult:
    """Descent from the result of `from_waves`."""
    return GaussNewton(inversion.reduced, callback=callback).descend(from_waves(inversion, callback).x)


def of_start(optimiser: Callable) -> Callable:
    """An optimiser with J only."""
    return lambda inversion, callback: optimiser(inversion.reduced, inversion.start, callback=callback)


WAYS = {"direct inversion": helmholtz, "local frequency": local_frequency}
DESCENTS = (
    ("ngbrain:GN from waves", "waves", from_waves),
    ("ngbrain:GN", "uniform", gauss_newton),
    ("ngbrain:GN both", "both", both),
    ("ngbrain:LM", "uniform", of_start(levenberg_marquardt)),
    ("ngbrain:Newton-CG", "uniform", of_start(newton_cg)),
    ("ngbrain:L-BFGS", "uniform", of_start(l_bfgs)),
    ("ngbrain:BFGS", "uniform", of_start(bfgs)),
)


def chart(records: list[Record], png: str) -> None:
    """A panel for each noise."""
    noises = sorted({r["noise"] for r in records})
    plt, made, panels = figure(4.2 * len(noises) + 2.2, 4.4, len(noises))
    methods = list(dict.fromkeys(r["method"] for r in records))
    styles = {}
    for k, method in enumerate(m for m in methods if m.startswith("ngbrain:")):
        styles[method] = {
            "color": (*STRONG, "#000000", "#CC79A7")[k],
            "marker": "oDsoDsv"[k],
            "linestyle": "",
            "ms": 8,
            "zorder": 4,
        }
    styles["direct inversion"] = {"color": "#8c7853", "marker": "^", "linestyle": "", "ms": 8, "zorder": 3}
    styles["local frequency"] = {"color": "#7f9a8a", "marker": "v", "linestyle": "", "ms": 8, "zorder": 3}
    styles[PUBLISHED] = {"color": "#4d4d4d", "marker": ".", "linestyle": "--", "lw": 1.2, "ms": 8, "zorder": 3}
    for axes, noise in zip(np.atleast_1d(panels), noises, strict=True):
        rows = [r for r in records if r["noise"] == noise]
        for r in rows:
            r["ndof"] = r.get("iterations") or 0  # lines follow the iterations
        last = noise == noises[-1]
        front(rows, axes, title=f"{100 * noise:g} % noise", styles=styles, legend=last, size="iterations")
    made.suptitle("Complex shear modulus of a stiff spot from its waves at 50 Hz: error against time")
    made.savefig(png, dpi=140)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    error = "-" if r["error"] is None else f"{100 * r['error']:.3g} %"
    parts = "" if "loss" not in r else f"G' {100 * r['storage']:.3g} G'' {100 * r['loss']:.3g}"
    state = "" if r["converged"] else f"  failed {r.get('reason', '')}"
    return f"{100 * r['noise']:g} % {r['method']:<24}{error:>10} {r['cpu_s']:8.2f} s  {parts}{state}"


if __name__ == "__main__":
    _command.main(__doc__, measure, chart, line)
