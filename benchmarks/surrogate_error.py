"""Error against time for a map: the trained operator, two steps of Gauss-Newton after it, inversions, and direct methods.

Test samples of `ngbrain.surrogate.data.dataset` (families that the operator has learnt, seeds that it has not seen), on 51 ×
51 points,
with noise η = σ · rms(component without its affine part), white or, of compression, with the longest grain that the training has
(`grain`, edges). Moduli as the data's rheology has them: the error of a wave is that of G′ (of E where nothing is lost), of a
compression that of E over its mean; all are in `errors`. `parts` has that of the first modulus within .03 of the edge of sharp
families' jumps, and of what is farther away, each over the truth's norm there. The inversions use elements of their own, not those
the data were made with. CPU time of one thread, of one map, of everything that follows reading the data.

    python benchmarks/surrogate_error.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/surrogate_error.py --chart FILE.png < records.json
    python benchmarks/surrogate_error.py --table < records.json      mean errors, %; of sharp families at edges / on plateaus too
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache, lru_cache
from itertools import product

import numpy as np
from _command import main, sweep
from _front import figure
from scipy.ndimage import distance_transform_edt, map_coordinates

from ngbrain import parallel
from ngbrain.adjoint import Reduced
from ngbrain.errors import NgbrainError
from ngbrain.inverse import (
    ElastographyProblem,
    GaussNewton,
    LeastSquares,
    discretise,
    elastography,
    fit_smooth_field,
    helmholtz_of_curl,
    invert,
    local_frequency,
    noise_deviation,
    smooth,
    unknowns_from_maps,
)
from ngbrain.io import WaveData
from ngbrain.surrogate import DENSITY, GRAIN, SHARP, SIDES, SMOOTH, Operator, Sample, add_noise, predict, sample

Record = dict
ACROSS, SEED = 51, 0
FAMILIES = (*SMOOTH, *SHARP, "tumour")
NOISES = (0.0, 0.01, 0.02, 0.05, 0.1, 0.15)
SLOW_NOISES, SLOW_FAMILIES = (0.0, 0.01, 0.05), ("gaussian_width", "inclusions")
SLOWEST = 0.01
"""Noise levels of the comparison; noise for the inversion of all points, which takes minutes."""
MANY, FEW = 10, 1
"""Samples of a family for methods of milliseconds, and for those of many seconds."""
GRAINED = (0.01, 0.05)
"""Noise of compression that has a grain too."""
PARTS = ("edge", "plateau")
NEAR, JUMP = 0.03, 0.05
"""Distance to a jump of the truth, in edges, and the least of its logarithm from one point to the next."""
LEAST = 1e-3
"""Least noise given to an inversion."""
COLOURS = {
    "ngbrain:surrogate": "#0072B2",
    "ngbrain:surrogate, checked": "#000000",
    "ngbrain:surrogate + 2 GN": "#56B4E9",
    "ngbrain:NLI": "#D55E00",
    "ngbrain:NLI, every second point": "#E69F00",
    "ngbrain:DI": "#009E73",
    "ngbrain:LFE": "#CC79A7",
    "ngbrain:1/strain": "#8c7853",
}


def measured(modality: str, family: str, index: int, noise: float, grain: float = 0.0) -> WaveData:
    """A test sample as wave data, with its truth; ultrasound has the axial component alone."""
    one = clean(modality, family, index)
    seed = [index, round(1000 * noise)]
    u = add_noise(one.displacement[None], np.array([noise]), np.random.default_rng(seed), np.array([grain]))[0]
    if modality == "compression":
        u = np.concatenate([np.full_like(u, np.nan), u], axis=-1)
    line = np.linspace(0, SIDES[modality], ACROSS)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    lossy = bool(one.loss.any())
    truth = one.storage + 1j * one.loss if modality == "waves" else one.storage
    return WaveData(
        points,
        u.reshape(1, -1, 2),
        np.array([one.frequency]),
        DENSITY,
        "isotropic",
        "viscoelastic" if lossy else "elastic",
        poisson=one.poisson,
        noise=noise or None,
        truth={"shear" if modality == "waves" else "youngs": truth.ravel()},
    )


@lru_cache(MANY)
def clean(modality: str, family: str, index: int) -> Sample:
    """A test sample without noise."""
    return sample(modality, family, SEED, "test", index, ACROSS)


def of_surrogate(data: WaveData) -> dict[str, np.ndarray]:
    """Maps of the shipped operator with their standard deviations: input channels and prediction."""
    name = "waves" if data.frequency[0] else "compression"
    operator = Operator.load_default(name)
    u = data.displacement.reshape(1, ACROSS, ACROSS, 2)[..., slice(None) if name == "waves" else slice(1, None)]
    u = u if name == "waves" else u.real
    (mean,), _ = operator(operator.kind.features(u / SIDES[name], np.array([data.poisson])))
    if name == "compression":
        return {"youngs": np.exp(mean[0]).ravel()}
    unit = operator.kind.unit(mean[:1], data.frequency, DENSITY, SIDES[name])[0]
    return of_shear(data, unit * np.exp(mean[0].ravel()) * (1 + 1j * mean[1].ravel()))


def checked(data: WaveData) -> dict[str, np.ndarray]:
    """The same by `predict`, with trust scores."""
    return predict(data).maps


def refined(data: WaveData) -> dict[str, np.ndarray]:
    """Two Gauss-Newton iterations from the prediction."""
    experiment = ElastographyProblem(data, discretise(data))
    sigma = noise_deviation(data, max(data.noise or 0, LEAST))
    unknowns = experiment.unknowns(sigma)
    x = unknowns_from_maps(experiment, unknowns, predict(data).maps)
    names = [name for name in unknowns.blocks if name != "boundary"]
    regularisers = {name: smooth(experiment.space, unknowns.start[unknowns.blocks[name]]) for name in names}
    misfit = LeastSquares(experiment.measured, sigma)
    problem = Reduced(experiment.model, misfit, unknowns, regularisers, dict.fromkeys(names, elastography.invert.FIRST))
    return experiment.maps(unknowns, GaussNewton(problem).descend(x, 2).x)


def inverted(data: WaveData) -> dict[str, np.ndarray]:
    """The complete inversion from measured waves, with smooth fields and evidence weights."""
    noise = max(data.noise or 0, LEAST)
    return invert(data, discretise(data), noise=noise, regulariser="smooth", uniform=False).maps


def inverted_coarsely(data: WaveData) -> dict[str, np.ndarray]:
    """The same from every second point along x and y, with maps interpolated to all points by splines."""
    few = np.arange(len(data.points)).reshape(ACROSS, ACROSS)[::2, ::2].ravel()
    picked = {"points": data.points[few], "displacement": data.displacement[:, few], "mask": None, "dirichlet": None}
    coarse = replace(data, **picked, truth={name: values[few] for name, values in data.truth.items()})
    n = (ACROSS + 1) // 2
    return {
        name: zoom(values.reshape(n, n), (ACROSS - 1) / (n - 1)).ravel() for name, values in inverted(coarse).items()
    }


def zoom(values: np.ndarray, times: float) -> np.ndarray:
    """Cubic spline interpolation of a grid to a finer one."""
    n = len(values)
    at = np.linspace(0, n - 1, round((n - 1) * times) + 1)
    return map_coordinates(values, np.meshgrid(at, at, indexing="ij"), order=3, mode="nearest")


def of_shear(data: WaveData, shear: np.ndarray) -> dict[str, np.ndarray]:
    """Maps of the data's rheology."""
    if data.rheology == "elastic":
        return {"youngs": data.youngs_of(np.real(shear))}
    return {"storage": np.real(shear), "loss": np.imag(shear)}


def direct(data: WaveData) -> dict[str, np.ndarray]:
    """Algebraic inversion of the curl over a window of three points."""
    return of_shear(data, helmholtz_of_curl(data, fit_smooth_field(data), 3 * SIDES["waves"] / (ACROSS - 1)))


def by_frequency(data: WaveData) -> dict[str, np.ndarray]:
    """Local frequency estimation: no loss."""
    shear = local_frequency(data)
    return of_shear(data, np.asarray(shear, complex))


def by_strain(data: WaveData) -> dict[str, np.ndarray]:
    """E over its mean as one over the axial strain of a smooth field: the strain image."""
    field = fit_smooth_field(replace(data, displacement=data.displacement[..., [1, 1]]))
    strain = np.real(field.gradient(data.points)[0, :, 1, 1])
    found = 1 / np.maximum(strain / strain.mean(), 0.2)
    return {"youngs": found / np.nanmean(found)}


QUICK: dict[str, dict[str, Callable[[WaveData], dict[str, np.ndarray]]]] = {
    "waves": {
        "ngbrain:surrogate": of_surrogate,
        "ngbrain:surrogate, checked": checked,
        "ngbrain:DI": direct,
        "ngbrain:LFE": by_frequency,
    },
    "compression": {
        "ngbrain:surrogate": of_surrogate,
        "ngbrain:surrogate, checked": checked,
        "ngbrain:1/strain": by_strain,
    },
}
SLOW = {
    "ngbrain:surrogate + 2 GN": refined,
    "ngbrain:NLI, every second point": inverted_coarsely,
    "ngbrain:NLI": inverted,
}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """A record for each method, sample and noise."""
    many, few = (2, 1) if quick else (MANY, FEW)
    cases = {}
    for modality in QUICK:
        for family, (noise, grain), index in product(FAMILIES, conditions(modality, quick), range(many)):
            slow = family in SLOW_FAMILIES[: 1 if quick else None] and noise in SLOW_NOISES and index < few
            told = (modality, family, noise, grain, index)
            cases[" ".join(map(str, told))] = (*told, slow and not grain)
    return [r for found in sweep(case, cases, executor) for r in found]


def case(modality: str, family: str, noise: float, grain: float, index: int, slow: bool) -> list[Record]:
    """A record for each method."""
    _ready(modality)
    data, methods = measured(modality, family, index, noise, grain), dict(QUICK[modality])
    if slow:
        methods |= {k: v for k, v in SLOW.items() if noise == SLOWEST or v is not inverted}
    told = {"modality": modality, "family": family, "noise": noise, "grain": grain, "sample": index}
    return [row(told, data, *each) for each in methods.items()]


@cache
def _ready(modality: str) -> None:
    """Load what the surrogate needs once per process, outside the measured time."""
    of_surrogate(measured(modality, "sinc", 0, 0.01))


def conditions(modality: str, quick: bool) -> list[tuple[float, float]]:
    """Noise and its grain."""
    white = [(noise, 0.0) for noise in (NOISES[:2] if quick else NOISES)]
    return white + [(noise, GRAIN) for noise in GRAINED[: 1 if quick else None] if modality == "compression"]


def row(told: Record, data: WaveData, name: str, method: Callable) -> Record:
    """Record of a method for a sample."""
    made: Record = {"method": name, "order": 0, "ndof": 2 * ACROSS**2, **told}
    made |= {"poisson": data.poisson, "frequency": float(data.frequency[0])}
    begun = time.process_time()
    try:
        maps = method(data)
    except NgbrainError as error:
        return made | {
            "reason": str(error),
            "error": 1.0,
            "errors": {},
            "parts": {},
            "cpu_s": time.process_time() - begun,
            "converged": False,
        }
    cpu = time.process_time() - begun
    errors, parts = {}, {}
    for key, truth in data.truth_views.items():
        found = maps[key]
        known = np.isfinite(found)
        if told["modality"] == "compression":
            found, truth = found / np.mean(found[known]), truth / np.mean(truth[known])
        errors[key] = relative(found, truth, known)
        if told["family"] in SHARP and not parts:
            near = beside_jumps(truth.reshape(ACROSS, ACROSS)).ravel()
            parts = {"edge": relative(found, truth, known & near), "plateau": relative(found, truth, known & ~near)}
    first = errors.get("storage", errors.get("youngs", 1.0))
    return made | {"error": first, "errors": errors, "parts": parts, "cpu_s": cpu, "converged": True}


def relative(found: np.ndarray, truth: np.ndarray, where: np.ndarray) -> float:
    """‖found - truth‖/‖truth‖ at some points."""
    return float(np.linalg.norm((found - truth)[where]) / np.linalg.norm(truth[where]))


def beside_jumps(truth: np.ndarray) -> np.ndarray:
    """Points (n, n) within `NEAR` of the middle between neighbours of which one is another material."""
    n = len(truth)
    apart = np.ones((2 * n - 1, 2 * n - 1), bool)
    steps = np.log(truth)
    apart[1::2, ::2] = np.abs(np.diff(steps, axis=0)) < JUMP
    apart[::2, 1::2] = np.abs(np.diff(steps, axis=1)) < JUMP
    if apart.all():
        return np.zeros_like(truth, bool)  # scipy's distances need something to be away from
    return distance_transform_edt(apart)[::2, ::2] <= 2 * (n - 1) * NEAR + 1e-9


def mean(records: list[Record], part: str | None = None, **of: object) -> float:
    """Mean error of records, or of a part of the points; for white noise by default."""
    of = {"grain": 0.0, **of}
    chosen = [r for r in records if all(r[key] == value for key, value in of.items())]
    values = [r["error"] if part is None else r["parts"].get(part, 1.0) for r in chosen]
    return float(np.mean(values)) if values else np.nan


def chart(records: list[Record], png: str) -> None:
    """Error over time at three noises; the operator's error over noise, white or grained; at edges, and on plateaus."""
    plt, made, grid = figure(16, 7.5, 3, 2)
    shades = {0.0: ("o", "no noise"), 0.01: ("s", "1 %"), 0.05: ("^", "5 %")}
    for (left, middle, right), modality in zip(grid, QUICK, strict=True):
        every = [r for r in records if r["modality"] == modality]
        few = [r for r in every if r["family"] in SLOW_FAMILIES and r["sample"] < FEW and not r["grain"]]
        for method, colour in COLOURS.items():
            for noise, (marker, _) in shades.items():
                rows = [r for r in few if r["method"] == method and r["noise"] == noise]
                if not rows:
                    continue
                failed = any(not r["converged"] for r in rows)
                x, y = np.median([r["cpu_s"] for r in rows]), 100 * np.mean([r["error"] for r in rows])
                left.plot(x, y, "x" if failed else marker, color=colour, ms=8, mfc=colour if noise else "none")
            if any(r["method"] == method for r in few):
                left.plot([], [], "-", lw=5, color=colour, label=method.partition(":")[2])
        left.set(xscale="log", xlabel="CPU time of a map, one thread (s)")
        left.set_title(f"{modality}: Gaussian spots and sharp inclusions")
        ours = [r for r in every if r["method"] == "ngbrain:surrogate"]
        grained = sorted({r["noise"] for r in ours if r["grain"]})
        for family in FAMILIES:
            rows = [r for r in ours if r["family"] == family]
            line = [100 * mean(rows, noise=noise) for noise in NOISES]
            style = "o-" if family in SMOOTH else "s--"
            (drawn,) = middle.plot([100 * n for n in NOISES], line, style, ms=4, label=family)
            points = [100 * mean(rows, noise=noise, grain=GRAIN) for noise in grained]
            middle.plot([100 * n for n in grained], points, "*", ms=10, mfc="none", color=drawn.get_color())
            if family not in SHARP:
                continue
            for part, dash in zip(PARTS, ("s--", "s-"), strict=True):
                line = [100 * mean(rows, part, noise=noise) for noise in NOISES]
                label = f"{family}, {part}"
                right.plot([100 * n for n in NOISES], line, dash, ms=4, label=label, color=drawn.get_color())
        if grained:
            middle.plot([], [], "k*", ms=10, mfc="none", label=f"grain of {GRAIN} edges")
        middle.axhline(2, color="#b22222", lw=1, ls=":", label="asked for, Gaussian, 1 %")
        middle.set_title(f"{modality}: the trained operator, {MANY} samples each")
        right.set_title(f"{modality}: within {NEAR} edges of a jump, and farther away")
        for axes in (left, middle, right):
            axes.set(yscale="log", ylabel="mean relative error, %")
            axes.legend(fontsize=8, ncols=1 if axes is left else 2)
            axes.grid(True, which="both", alpha=0.25)
        for axes in (middle, right):
            axes.set(xlabel="noise, %")
            axes.margins(y=0.3)  # room for the legend
    for marker, text in shades.values():
        grid[0][0].plot([], [], marker, color="k", mfc="none" if text == "no noise" else "k", label=text)
    grid[0][0].legend(fontsize=8)
    made.savefig(png, dpi=130)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    errors = ", ".join(f"{name} {100 * value:.3g} %" for name, value in r["errors"].items()) or r["reason"]
    errors += "".join(f", {part} {100 * value:.3g} %" for part, value in r["parts"].items())
    noise = f"{100 * r['noise']:g} %" + (" grained" if r["grain"] else "")
    return f"{r['modality']} {r['family']} {r['sample']} {noise} {r['method']:<26} {errors}, {r['cpu_s']:.3f} s"


def table(records: list[Record]) -> str:
    """Mean errors of families at each noise, white and grained, for quick methods; of the slow comparison; and of parts."""
    lines = []

    def cells(rows: list[Record], conditions: Iterable[tuple[float, float]], part: str | None = None) -> str:
        found = (mean(rows, part, noise=noise, grain=grain) for noise, grain in conditions)
        return " | ".join(f"{100 * each:.2f}" for each in found)

    for modality, methods in QUICK.items():
        every = [r for r in records if r["modality"] == modality]
        noises = conditions(modality, quick=False)
        for method, family in product(methods, FAMILIES):
            rows = [r for r in every if (r["method"], r["family"]) == (method, family)]
            lines.append(f"| {modality} | {method} | {family} | {cells(rows, noises)} |")
            if family in SHARP:
                parts = (f"| {modality} | {method} | {family}, {p} | {cells(rows, noises, p)} |" for p in PARTS)
                lines.extend(parts)
        for method in (*methods, *SLOW):
            rows = [r for r in every if r["method"] == method and r["family"] in SLOW_FAMILIES and r["sample"] < FEW]
            rows = [r for r in rows if not r["grain"]]
            cpu = np.median([r["cpu_s"] for r in rows])
            lines.append(
                f"| {modality} | {method} | the same {len(rows)} | {cells(rows, product(SLOW_NOISES, [0.0]))} | {cpu:.3g} s |"
            )
            for part in PARTS:
                sharp = [r for r in rows if r["family"] in SHARP]
                lines.append(
                    f"| {modality} | {method} | of them sharp, {part} | {cells(sharp, product(SLOW_NOISES, [0.0]), part)} |"
                )
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1:] == ["--table"]:
        print(table(json.loads(sys.stdin.read())))
    else:
        main(__doc__, measure, chart, line)
