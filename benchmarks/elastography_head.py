"""Elastography of a whole head: inversion with and without labels, algebraic inversion and local frequency.

Waves of the MNI152 brain at 50 Hz, two directions, simulated with fourth order on tetrahedra of 12 mm whose moduli follow the
tissue at every quadrature point; ventricles filled with a soft fluid; points every 2 mm in grey and white matter, 2 % noise, one
seed; a ball of 15 mm twice as stiff as white matter. The medians of the tissues are over all their points, `contrast` is the
median of the ball's core (a voxel off its border) over that of the 5 mm around it, `true_contrast` the same of the truth. Every
row has a process of its own on two threads; its time is all that it takes from data to maps, `peak_gib` all that it holds. "truth"
is no method: the logarithm of the truth, smoothed by a Gaussian of that full width at half its height within the points, is what
a perfect method of that resolution would find.

With --maps the rows of MRE134 are measured too: the truth is then the mean stiffness and damping ratio of 134 adults at 50 Hz
(MRE134_Stiffness3D.nii.zip and MRE134_Damping3D.nii.zip of https://github.com/mechneurolab/MRE134; Hiscox et al. 2020,
10.1002/hbm.25192), which lie in the space of MNI152, with the ball and, as a mean is smooth, single voxels of 2 mm that are off it
by 15 % (standard deviation of the logarithm, seeded). Simulated and inverted is a cube of 6 cm around the ball, cut out of the
head, whose boundary is shaken as the skull is: of the whole head the process was killed for want of memory, beside other work.
`rms_ln` is the rms of ln |G*| over its truth at all of its points; away from the ball `rank` is Spearman's rank correlation of G'
with the truth's, `rank_smooth` with that of the map without single voxels, and `detail` the share of the single voxels' deviation
from the map that the answer has, by regression.

    python benchmarks/elastography_head.py [--quick] [--json] [--maps STIFFNESS DAMPING] [--only ROW ...]
                                                                   last line of --json: a list of records
    python benchmarks/elastography_head.py --chart FILE.png < records.json
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from _command import main
from _front import figure
from _head_waves import CENTRE, NAMES, RADIUS, head, waves_of_head
from scipy.ndimage import gaussian_filter
from scipy.stats import spearmanr

from ngbrain.inverse import Iteration, discretise, fit_smooth_field, helmholtz_of_curl, invert_in_space, local_frequency
from ngbrain.io import WaveData
from ngbrain.threads import threads

Record = dict
Answer = Callable[[WaveData, bool], tuple[np.ndarray, Record]]
NOISE, THREADS, ROUNDS = 0.02, 2, 3
FINE, COARSE = (12e-3, "P4", 2e-3), (20e-3, "P2", 6e-3)
"""Elements that waves are simulated with (m, form) and the distance of points (m); for `--quick`."""
TISSUES = NAMES[:3]
COLOURS = dict(zip(TISSUES, ("#0072B2", "#56B4E9", "#D55E00"), strict=True))


def algebraic(data: WaveData, quick: bool) -> tuple[np.ndarray, Record]:
    """Algebraic inversion of the curl, in windows of 5 mm."""
    return helmholtz_of_curl(data, fit_smooth_field(data), 5e-3), {}


def frequency(data: WaveData, quick: bool) -> tuple[np.ndarray, Record]:
    """Local frequency estimation, of the magnitude only."""
    return local_frequency(data), {}


def fields(data: WaveData, quick: bool) -> tuple[np.ndarray, Record]:
    """Inversion with one field for all tissue."""
    return _inverted(data, False, quick)


def labels(data: WaveData, quick: bool) -> tuple[np.ndarray, Record]:
    """Inversion with a field for each label."""
    return _inverted(data, True, quick)


def blurred(width: float) -> Answer:
    """The truth smoothed over a width (m)."""

    def answer(data: WaveData, quick: bool) -> tuple[np.ndarray, Record]:
        first, last = data.points.min(axis=0), data.points.max(axis=0)
        spacing = np.linalg.norm(data.points[1] - data.points[0])
        shape = (np.rint((last - first) / spacing).astype(int) + 1)[::-1]
        sigma = width / spacing / np.sqrt(8 * np.log(2))

        def smooth(values: np.ndarray) -> np.ndarray:
            return gaussian_filter(np.where(data.mask, values, 0).reshape(shape), sigma).ravel()

        logarithm = np.log(np.where(data.mask, data.truth["shear"], 1))
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = (smooth(logarithm.real) + 1j * smooth(logarithm.imag)) / smooth(np.ones(len(logarithm)))
        return np.where(data.mask, np.exp(mean), np.nan), {}

    return answer


ROWS: dict[str, Answer] = {
    "algebraic": algebraic,
    "local frequency": frequency,
    "ngbrain:inversion": fields,
    "ngbrain:inversion, labels": labels,
    **{f"truth, {1e3 * width:g} mm": blurred(width) for width in (4e-3, 6e-3, 8e-3)},
}
MEASURED = "MRE134: "
"""Prefix of rows whose truth is a measured map."""
ROWS |= {MEASURED + name: ROWS[name] for name in ("algebraic", "local frequency", "ngbrain:inversion", "truth, 6 mm")}
Maps = tuple[str, str]


def _inverted(data: WaveData, labelled: bool, quick: bool) -> tuple[np.ndarray, Record]:
    begun = time.time()

    def callback(it: Iteration) -> None:
        about = f"{it.phase}: misfit {it.misfit / it.expected:.3g}, change {it.change:.3f}, step {it.step:.2g}"
        print(f"{time.time() - begun:.0f} s {about}", file=sys.stderr, flush=True)

    elements = discretise(data, order=2) if quick else None
    found = invert_in_space(
        data, elements, noise=NOISE, labelled=labelled, max_iterations=1 if quick else ROUNDS, callback=callback
    )
    more = {
        "order": 2 if quick else 3,
        "ndof": found.model["n_unknowns"],
        "elements": found.model["n_elements"],
        "misfit": found.checks["misfit_over_expected"],
        "converged": found.checks["converged"],
        "rounds": len(found.starts[-1].history),
    }
    return found.maps["storage"] + 1j * found.maps["loss"], more


def measure(quick: bool, maps: list[str] | None = None, only: list[str] | None = None) -> list[Record]:
    """One record for each method."""
    files = [Path(each) for each in maps or ()]
    missing = (
        ["--maps is not given"] if not files else [f"{each.name} is not there" for each in files if not each.exists()]
    )
    records = []
    for method in only or ROWS:
        of = tuple(maps or ()) if method.startswith(MEASURED) else None
        if of is not None and missing:
            print(f"{method}: skipped, {missing[0]}", file=sys.stderr, flush=True)
            continue
        with threads(THREADS):
            waves_of_head(*(COARSE if quick else FINE), of)
        with ProcessPoolExecutor(1, get_context("spawn")) as executor:
            records.append(executor.submit(row, method, quick, of).result())
        print(line(records[-1]), file=sys.stderr, flush=True)
    return records


def row(method: str, quick: bool, maps: Maps | None = None) -> Record:
    """Run in a separate process."""
    data = waves_of_head(*(COARSE if quick else FINE), maps).with_noise(NOISE, seed=0)
    with threads(THREADS):
        begun, cpu = time.time(), time.process_time()
        modulus, more = ROWS[method](data, quick)
        spent = {"wall_s": time.time() - begun, "cpu_s": time.process_time() - cpu}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    common = {"method": method, "order": None, "ndof": None, "converged": True}
    found = {**common, **judged(data, modulus), **more, **spent, "peak_gib": peak, "threads": THREADS}
    return found | (against_map(data, modulus, maps) if maps else {})


def judged(data: WaveData, modulus: np.ndarray) -> Record:
    """Errors against the truth, where there is a result."""
    away, known = np.linalg.norm(data.points - CENTRE, axis=1), _known(data, modulus)
    truth, label = data.truth["shear"], data.labels
    core, around = known & (away < RADIUS - 2e-3), known & (away > RADIUS) & (away < RADIUS + 5e-3)
    lossy = bool(np.abs(modulus.imag[known]).max() > 0)
    parts: dict[str, Callable] = {"storage": np.real, "loss": np.imag} if lossy else {"size": np.abs}
    off = {
        name: {
            kind: float(np.median(part(modulus[here])) / np.median(part(truth[here])) - 1)
            for kind, part in parts.items()
        }
        for name, here in ((name, known & (label == i)) for i, name in enumerate(TISSUES))
    }
    contrast, true = (
        {kind: float(np.median(part(g[core])) / np.median(part(g[around]))) for kind, part in parts.items()}
        for g in (modulus, truth)
    )
    error = max(abs(each) for kinds in off.values() for each in kinds.values())
    return {"error": error, "median_off": off, "contrast": contrast, "true_contrast": true, "points": int(known.sum())}


def against_map(data: WaveData, modulus: np.ndarray, maps: Maps) -> Record:
    """Agreement with a map that varies from point to point."""
    known = _known(data, modulus)
    outside = known & (np.linalg.norm(data.points - CENTRE, axis=1) > RADIUS + 2e-3)
    truth, smooth = data.truth["shear"], np.zeros_like(data.truth["shear"])
    smooth[data.mask] = head(maps).smooth_at(data.points[data.mask])
    size = np.real if np.abs(modulus.imag[known]).max() > 0 else np.abs
    found, true, mean = (size(each[outside]) for each in (modulus, truth, smooth))
    rough, answered = np.log(true / mean), np.log(np.maximum(found, 1.0) / mean)
    return {
        "rms_ln": float(np.sqrt(np.mean(np.log(np.abs(modulus[known]) / np.abs(truth[known])) ** 2))),
        "rank": float(spearmanr(found, true).statistic),
        "rank_smooth": float(spearmanr(found, mean).statistic),
        "detail": float(np.cov(answered, rough)[0, 1] / np.var(rough, ddof=1)),
    }


def _known(data: WaveData, modulus: np.ndarray) -> np.ndarray:
    return data.mask & np.isfinite(modulus) & (modulus != 0)


def chart(records: list[Record], png: str) -> None:
    """Medians of tissues and contrast of the ball against time."""
    plt, made, (left, right) = figure(11, 4.8, 2)
    marks = {"storage": "o", "loss": "s", "size": "D"}
    for r in (r for r in records if not r["method"].startswith(("truth", MEASURED))):
        for kind in r["contrast"]:
            for name in TISSUES[:2]:
                left.plot(r["wall_s"], 100 * abs(r["median_off"][name][kind]), marks[kind], color=COLOURS[name], ms=8)
            right.plot(r["wall_s"], r["contrast"][kind], marks[kind], color=COLOURS["inclusion"], ms=8)
        kind = next(iter(r["contrast"]))
        middle = 100 * abs(r["median_off"]["grey"][kind])
        right_of, above = (8, -12) if "labels" in r["method"] else (8, 6)
        for axes, y in ((left, middle), (right, r["contrast"][kind])):
            axes.annotate(
                r["method"].removeprefix("ngbrain:"),
                (r["wall_s"], y),
                textcoords="offset points",
                xytext=(right_of, above),
                fontsize=8,
            )
    for name in TISSUES[:2]:
        left.plot([], [], "o", color=COLOURS[name], label=f"{name} matter")
    for kind, mark in marks.items():
        left.plot([], [], mark, color="0.5", label={"size": "|G*|"}.get(kind, f"{kind} modulus"))
    left.axhspan(0.5, 5, color="0.85", zorder=0, label="within 5 %")
    right.axhspan(0.8 * 2, 1.2 * 2, color="0.9", zorder=0, label="within 20 %")
    right.axhspan(0.9 * 2, 1.1 * 2, color="0.8", zorder=0, label="within 10 %")
    right.axhline(2, color="0.4", ls="--", lw=1, label="truth")
    left.set(
        xscale="log", yscale="log", xlabel="time on two threads, s", ylabel="median over a tissue off the truth, %"
    )
    left.set_yticks([1, 5, 20, 100, 300], ["1", "5", "20", "100", "300"])
    left.minorticks_off()
    right.set(xscale="log", xlabel="time on two threads, s", ylabel="contrast of the ball")
    for axes in (left, right):
        axes.grid(True, alpha=0.3)
        axes.margins(x=0.35, y=0.2)
        axes.legend(fontsize=8, loc="lower left")
    made.suptitle("Waves in the MNI152 head: two directions at 50 Hz, points every 2 mm, 2 % noise")
    made.savefig(png, dpi=130)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    off = ", ".join(
        f"{name} {' and '.join(f'{100 * v:+.1f}' for v in r['median_off'][name].values())} %" for name in TISSUES
    )
    contrast = " and ".join(f"{v:.2f}" for v in r["contrast"].values())
    size = f" {r['ndof']} unknowns, misfit {r['misfit']:.2f}, {r['rounds']} rounds," if r["ndof"] else ""
    measured = f"; rms ln {r['rms_ln']:.2f}, rank {r['rank']:.2f}" if "rms_ln" in r else ""
    return f"{r['method']}:{size} {off}; contrast {contrast}; {r['wall_s']:.0f} s, {r['peak_gib']:.1f} GiB{measured}"


if __name__ == "__main__":
    main(
        __doc__,
        measure,
        chart,
        line,
        maps={"nargs": 2, "metavar": ("STIFFNESS", "DAMPING"), "help": "NIfTI, also in a ZIP archive"},
        only={"nargs": "+", "choices": ROWS, "metavar": "ROW", "help": "of " + "; ".join(ROWS)},
    )
