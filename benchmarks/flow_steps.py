"""Error against time of a Maxwell branch at finite strain: our step, backward Euler, and an explicit peer.

A thousand material points of an Ogden spring (α = -18) and its dashpot (τ = 0.8 s) are stretched and sheared over 2 s
so that axes turn; a second path has a dashpot a hundred times as quick. Error: of the Kirchhoff overstress at the end,
relative to scipy's DOP853 at 1e-11 on Reese and Govindjee's equation. The peer is that equation by the classical
Runge-Kutta method in numpy, all points at once; where its steps are too long it blows up, which is drawn as a failure.

    python benchmarks/flow_steps.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/flow_steps.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from _command import main
from scipy.integrate import solve_ivp

from ngbrain.errors import require
from ngbrain.materials import Maxwell, MaxwellVariables, Ogden, Points, maxwell

MU, ALPHA, END, POINTS = 1000.0, -18.0, 2.0, 1000
ETAS = {"τ = 0.8 s": 800.0, "τ = 8 ms": 8.0}


def path(t: float) -> np.ndarray:
    """F(t), isochoric."""
    s, g = 1 + 0.2 * np.sin(1.7 * t), 0.3 * np.sin(2.3 * t)
    return np.array([[s, g, 0], [0, s**-0.5, 0], [0, 0, s**-0.5]])


def velocity(t: float, h: float = 1e-5) -> np.ndarray:
    """The velocity gradient of the path."""
    return (path(t + h) - path(t - h)) / (2 * h) @ np.linalg.inv(path(t))


def kirchhoff(b: np.ndarray) -> np.ndarray:
    """Overstress of elastic left stretches b (…, 3, 3)."""
    values, vectors = np.linalg.eigh(b)
    by_log = 2 * MU / ALPHA * values ** (ALPHA / 2)
    by_log = by_log - by_log.mean(axis=-1, keepdims=True)
    return (vectors * by_log[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def rate(t: float, b: np.ndarray, eta: float) -> np.ndarray:
    """db_e/dt."""
    l = velocity(t)
    return l @ b + b @ l.T - kirchhoff(b) @ b / eta


def exact(eta: float) -> np.ndarray:
    """The overstress at the end."""

    def change(t: float, y: np.ndarray) -> np.ndarray:
        return rate(t, y.reshape(3, 3), eta).ravel()

    solved = solve_ivp(change, (0, END), np.eye(3).ravel(), rtol=1e-11, atol=1e-13, method="DOP853")
    return kirchhoff(solved.y[:, -1].reshape(3, 3))


def explicit(eta: float, n: int) -> np.ndarray:
    """Classical Runge-Kutta, n steps, all points."""
    b, h = np.tile(np.eye(3), (POINTS, 1, 1)), END / n
    for k in range(n):
        t = k * h
        k1 = rate(t, b, eta)
        k2 = rate(t + h / 2, b + h / 2 * k1, eta)
        k3 = rate(t + h / 2, b + h / 2 * k2, eta)
        b = b + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + h, b + h * k3, eta))
    return kirchhoff(b)[0]


class BackwardEuler(MaxwellVariables):
    """The textbook's step: no flow before it, κ = η/Δt."""

    def begin(self, dt: float, shapes: np.ndarray) -> None:
        """Start a step."""
        super().begin(1e-12 * dt, shapes)
        self.kappa = self.eta / dt


def stepped(kind: type[MaxwellVariables], eta: float, n: int) -> np.ndarray:
    """n steps of a branch, all points."""
    flow = kind(Points.line(POINTS), Maxwell(Ogden(MU, ALPHA), eta).slopes, eta)
    before = six(np.eye(3))
    for k in range(1, n + 1):
        after = six(path(END * k / n).T @ path(END * k / n))
        flow.begin(END / n, before)
        flow.relax(after)
        flow.finish(after)
        before = after
    S, F = maxwell.tensors(flow.stress)[0], path(END)
    tau = F @ S @ F.T
    return tau - np.trace(tau) / 3 * np.eye(3)


def six(C: np.ndarray) -> np.ndarray:
    """One shape at all points."""
    return np.outer([C[i, j] for i, j in maxwell.ENTRIES], np.ones(POINTS))


METHODS: dict[str, tuple[int, Callable[[float, int], np.ndarray]]] = {
    "ngbrain:Maxwell": (2, lambda eta, n: stepped(MaxwellVariables, eta, n)),
    "ngbrain:backward Euler": (1, lambda eta, n: stepped(BackwardEuler, eta, n)),
    "numpy Runge-Kutta": (4, explicit),
}


def measure(quick: bool) -> list[dict]:
    """One record for each method, dashpot and number of steps."""
    records = []
    for case, eta in ETAS.items():
        truth = exact(eta)
        for method, (order, solve) in METHODS.items():
            for n in (4, 16, 64) if quick else (2, 4, 8, 16, 32, 64, 128, 256, 512):
                start = time.process_time()
                with np.errstate(all="ignore"):
                    try:
                        error = float(np.linalg.norm(solve(eta, n) - truth) / np.linalg.norm(truth))
                    except np.linalg.LinAlgError:
                        error = float("nan")
                seconds = time.process_time() - start
                good = bool(error < 0.9)
                record = {"method": method, "case": case, "order": order, "steps": n, "ndof": POINTS}
                records.append({**record, "error": error if good else None, "cpu_s": seconds, "converged": good})
    return records


def chart(records: list[dict], path: str) -> None:
    """Error against CPU time, a panel for each dashpot; failures are crosses on top."""
    plt = require("matplotlib.pyplot", "report")
    figure, panels = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained", sharey=True)
    top = 2 * max(r["error"] for r in records if r["converged"])
    for axes, case in zip(panels, ETAS, strict=True):
        for method, colour in zip(METHODS, ("#0072B2", "#D55E00", "#009E73"), strict=True):
            rows = [r for r in records if (r["method"], r["case"]) == (method, case)]
            good, bad = ([r for r in rows if r["converged"] is state] for state in (True, False))
            axes.loglog([r["cpu_s"] for r in good], [r["error"] for r in good], "o-", color=colour, label=method)
            axes.loglog([r["cpu_s"] for r in bad], [top] * len(bad), "x", color=colour, ms=9, mew=2)
        axes.set(xlabel="CPU time of 1000 points (s)", title=f"{case}, 2 s of stretching and shearing")
        axes.grid(alpha=0.3, which="both")
    panels[0].set_ylabel("relative error of the overstress      (crosses: failed)")
    panels[0].legend(fontsize=9)
    figure.savefig(path, dpi=150)


def line(r: dict) -> str:
    """One record as text."""
    error = f"{r['error']:.1e}" if r["converged"] else "failed"
    return f"{r['case']:<11} {r['method']:<24} {r['steps']:4d} steps  {error:>8}  {r['cpu_s']:6.2f} s"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
