"""Trust in the trained operators: out-of-distribution detection, coverage of error bars, finer grids.

Insiders are test samples of the learnt families with 1 % noise. Outsiders, the same random draws but for one thing:

frequency   24 or 96 Hz instead of 30 to 80, and said so
misstated   a frequency that is a fifth off what it is said to be: tissue 1.44 times as stiff would move just so, and no
            displacement can tell; shown for honesty
modulus     a background twice beyond the ends of what was learnt; for compression, contrasts of 6 to 10
boundary    the edge opposite the driven one held; both driven against one another; a plate that sticks to the square
noise       10 %, white and with the longest grain of the training
half        the left half of a square is another's of its family
grained     1 % with that grain: no outsider, as half of the compression was learnt so; shown for honesty
unseen      slices of a brain, a family that was held out whole

`auc` is how often the largest score of an outsider is above that of an insider; `flagged` how many of each are. `coverage` of
intervals that should hold 50, 68, 90 and 95 % of points. `finer`: mean error on 101 points over that on 51, of the same samples
with noise of their own. `map_s`: of a 64 × 64 map with its deviation, features and all, on one core; `maps_per_s` in batches.

    python benchmarks/surrogate_trust.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/surrogate_trust.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from _command import main
from _front import figure

from ngbrain.surrogate import (
    DENSITY,
    FINE,
    FREQUENCY,
    GRAIN,
    SHARP,
    SHEAR,
    SIDES,
    SMOOTH,
    Operator,
    Sample,
    TilePrediction,
    add_noise,
    auc,
    data,
    family,
    relative_errors,
    sample,
    scores,
    solve_displacement,
)

Record = dict
LEARNT = (*SMOOTH, *SHARP, "tumour")
MANY, ACROSS, NOISE = 60, 51, 0.01
LEVELS = (0.5, 0.68, 0.9, 0.95)
Drawn = Callable[[int], Sample]


def usual(modality: str, across: int = ACROSS) -> Drawn:
    """Test samples, family by family."""
    return lambda i: sample(modality, LEARNT[i % len(LEARNT)], 0, "test", i // len(LEARNT), across)


def at(change: Callable[[np.random.Generator, np.ndarray], Sample], kind: str | None = None) -> Drawn:
    """Samples computed in another way."""

    def drawn(i: int) -> Sample:
        random = np.random.default_rng([i, 77])
        y, x = np.meshgrid(*2 * (np.linspace(0, 1, FINE),), indexing="ij")
        return change(random, family(kind or LEARNT[i % len(LEARNT)])(random, x, y))

    return drawn


def waves(
    frequency: Callable[[np.random.Generator], float] = lambda r: r.uniform(*FREQUENCY),
    factor: Callable[[np.random.Generator], float] = lambda r: 1.0,
    drive: Callable[[complex, complex], dict] = lambda a, b: {"top": (a, b)},
    held: str | None = None,
) -> Drawn:
    """Waves with one change."""

    def change(random: np.random.Generator, relative: np.ndarray) -> Sample:
        hertz, stiff = frequency(random), factor(random)
        storage = np.exp(random.uniform(*np.log(SHEAR))) * relative if stiff == 1 else stiff * relative
        loss = random.uniform(*data.dataset.LOSS) * storage
        poisson = random.uniform(*(data.dataset.COMPRESSIBLE if random.random() < 0.5 else data.dataset.NEARLY))
        angle = random.uniform(0, 2 * np.pi)
        u = solve_displacement(
            storage + 1j * loss, hertz, poisson, drive(1e-3 * np.cos(angle), 1e-3 * np.sin(angle)), ACROSS, held
        )
        return Sample(
            u, data.dataset._interpolate(storage, ACROSS), data.dataset._interpolate(loss, ACROSS), hertz, poisson
        )

    return at(change)


def compression(power: float = 1.0, held: dict[str, str] | None = None) -> Drawn:
    """Compression with other contrasts or boundary conditions."""
    side = SIDES["compression"]

    def change(random: np.random.Generator, relative: np.ndarray) -> Sample:
        poisson = random.uniform(*(data.dataset.COMPRESSIBLE if random.random() < 0.5 else data.dataset.NEARLY))
        contrast = random.uniform(6, 10) if power != 1 else 1.0
        inside = np.abs(relative - 1) > 0.25
        youngs = 1e4 * (np.where(inside, contrast, 1.0) if power != 1 else relative)
        u = solve_displacement(
            youngs / (2 * (1 + poisson)),
            0.0,
            poisson,
            {"top": (0, -0.01 * side)},
            ACROSS,
            held or {"x": "bottom", "y": "bottom|top"},
            side,
        )
        return Sample(
            u.real[..., 1:], data.dataset._interpolate(youngs, ACROSS), np.zeros((ACROSS, ACROSS)), 0.0, poisson
        )

    return at(change, "inclusions" if power != 1 else None)


def misstated(drawn: Drawn, factor: float) -> Drawn:
    """The stated frequency differs from the true one."""
    return lambda i: replace(drawn(i), frequency=drawn(i).frequency * factor)


def torn(modality: str) -> Drawn:
    """The left half of a test sample is replaced by that of another of its family."""

    def drawn(i: int) -> Sample:
        one, other = (usual(modality)(k) for k in (i, (i + len(LEARNT)) % (2 * MANY)))
        left = np.arange(ACROSS) < ACROSS // 2
        size = np.linalg.norm(one.displacement) / np.linalg.norm(other.displacement)
        storage, loss = (
            np.where(left, theirs, own) for own, theirs in ((one.storage, other.storage), (one.loss, other.loss))
        )
        u = np.where(left[:, None], size * other.displacement, one.displacement)
        return replace(one, displacement=u, storage=storage, loss=loss)

    return drawn


OUTSIDERS: dict[str, dict[str, tuple[Drawn, float] | tuple[Drawn, float, float]]] = {
    "waves": {
        "frequency 24 Hz": (waves(frequency=lambda r: FREQUENCY[0] / 1.25), NOISE),
        "frequency 96 Hz": (waves(frequency=lambda r: FREQUENCY[1] * 1.2), NOISE),
        "misstated +20 %": (misstated(usual("waves"), 1.2), NOISE),
        "misstated -20 %": (misstated(usual("waves"), 0.8), NOISE),
        "modulus half the least": (waves(factor=lambda r: SHEAR[0] / 2), NOISE),
        "modulus twice the most": (waves(factor=lambda r: SHEAR[1] * 2), NOISE),
        "boundary: opposite edge held": (waves(held="top|bottom"), NOISE),
        "boundary: two edges driven": (waves(drive=lambda a, b: {"top": (a, b), "bottom": (-a, -b)}), NOISE),
        "noise 10 %": (usual("waves"), 0.1),
        "half of another scan": (torn("waves"), NOISE),
        "unseen: brain slices": (lambda i: sample("waves", "slices", 0, "test", i, ACROSS), NOISE),
    },
    "compression": {
        "modulus: contrast 6 to 10": (compression(power=2.0), NOISE),
        "boundary: plate that sticks": (compression(held={"x": "bottom|top", "y": "bottom|top"}), NOISE),
        "boundary: sides held": (compression(held={"x": "bottom|left|right", "y": "bottom|top"}), NOISE),
        "noise 10 %": (usual("compression"), 0.1),
        "noise 10 %, grained": (usual("compression"), 0.1, GRAIN),
        "as learnt: grained": (usual("compression"), NOISE, GRAIN),
        "half of another scan": (torn("compression"), NOISE),
        "unseen: brain slices": (lambda i: sample("compression", "slices", 0, "test", i, ACROSS), NOISE),
    },
}
"""Generator, noise, and correlation length of each kind."""
UNASKED = ("misstated", "unseen", "as learnt")


def seen(
    operator: Operator, many: int, drawn: Drawn, noise: float, grain: float = 0.0
) -> tuple[list[TilePrediction], np.ndarray, np.ndarray]:
    """Predictions for samples; errors of the first quantity; and errors in standard deviations (answers, …)."""
    kind, looks, off, far = operator.kind, [], [], []
    for i in range(many):
        one = drawn(i)
        random = np.random.default_rng([i, round(1000 * noise)])
        u = add_noise(one.displacement[None], np.array([noise]), random, np.array([grain])) / SIDES[kind.name]
        features = kind.features(u, np.array([one.poisson]))
        mean, scale = operator(features)
        unit = kind.unit(one.storage[None], np.array([one.frequency]), DENSITY, SIDES[kind.name])
        truth = kind.targets(one.storage[None], one.loss[None], unit)
        looks.append(TilePrediction(kind, u[0], one.frequency, one.poisson, features[0], mean[0], scale[0]))
        off.append(relative_errors(mean, truth)[0, 0])
        far.append(np.abs(truth - mean)[0] / scale[0])
    return looks, np.array(off), np.array(far)


def measure(quick: bool) -> list[Record]:
    """One record of in-distribution samples and one for each kind of outsider, by modality."""
    many = 7 if quick else MANY
    records = []
    for name, outsiders in OUTSIDERS.items():
        operator = Operator.load_default(name)
        trust = operator.card.trust

        def judged(looks: list[TilePrediction], trust: dict = trust) -> tuple[np.ndarray, list[dict[str, float]]]:
            each = [scores(look, trust) for look in looks]
            return np.array([max(numbers.values()) for numbers in each]), each

        looks, off, far = seen(operator, 2 * many, usual(name), NOISE)
        inside, numbers = judged(looks)
        base: Record = {
            "method": "ngbrain:surrogate",
            "order": 0,
            "ndof": ACROSS**2,
            "modality": name,
            "converged": True,
        }
        finer = seen(operator, many, usual(name, 101), NOISE)[1].mean() / off[:many].mean()
        base |= speed(operator)
        coverage = {
            str(level): [
                float((far[:, k] < within).mean()) for k, within in enumerate(operator.card.coverage_factors(level))
            ]
            for level in LEVELS
        }
        flagged = float((inside > trust["threshold"]).mean())
        records.append(
            base
            | {
                "who": "insiders",
                "error": float(off.mean()),
                "flagged": flagged,
                "coverage": coverage,
                "finer": float(finer),
            }
        )
        for who, outsider in outsiders.items():
            begun = time.process_time()
            looks, off, _ = seen(operator, many, *outsider)
            outside, others = judged(looks)
            single = {
                key: auc(np.array([n[key] for n in numbers]), np.array([n[key] for n in others])) for key in numbers[0]
            }
            best = max(single, key=lambda key: single[key])
            record = base | {"who": who, "error": float(off.mean()), "auc": auc(inside, outside), "told_by": best}
            record |= {"flagged": float((outside > trust["threshold"]).mean()), "aucs": single}
            records.append(record | {"cpu_s": time.process_time() - begun})
    return records


def speed(operator: Operator, n: int = 64, batch: int = 64) -> Record:
    """Seconds of a map, the least of ten; maps a second in a batch."""
    kind = operator.kind
    one = sample(kind.name, "sinc", 0, "test", 0, n)
    u, poisson = np.repeat(one.displacement[None], batch, axis=0), np.full(batch, one.poisson)

    def took(count: int) -> float:
        begun = time.process_time()
        operator(kind.features(u[:count], poisson[:count]))
        return time.process_time() - begun

    took(1)
    single = min(took(1) for _ in range(10))
    return {"map_s": single, "maps_per_s": batch / min(took(batch) for _ in range(2)), "cpu_s": single}


def chart(records: list[Record], png: str) -> None:
    """Detection of outsiders; coverage of error bars."""
    plt, plot, (left, right) = figure(11, 4.6, 2, width_ratios=(1.7, 1))
    rows = [r for r in records if "auc" in r][::-1]
    for i, r in enumerate(rows):
        colour = "#999999" if r["who"].startswith(UNASKED) else "#0072B2" if r["auc"] >= 0.9 else "#D55E00"
        left.barh(i, r["auc"], color=colour, height=0.7)
        text = f"{r['auc']:.2f}, {100 * r['flagged']:.0f} % flagged, error {100 * r['error']:.0f} %"
        left.text(0.02, i, text, va="center", fontsize=7.5, color="white")
    left.axvline(0.9, color="#b22222", ls="--", lw=1.2)
    left.set_yticks(range(len(rows)), [f"{r['modality']}: {r['who']}" for r in rows], fontsize=8)
    left.set(
        xlim=(0, 1),
        xlabel="AUC of the largest score (asked for: 0.9; grey: not asked for)",
        title="Outsiders told from insiders",
    )
    for r, colour in zip([r for r in records if r["who"] == "insiders"], ("#0072B2", "#009E73"), strict=True):
        kinds = Operator.load_default(r["modality"]).kind.answers
        for k, answer in enumerate(kinds):
            held = [100 * r["coverage"][str(level)][k] for level in LEVELS]
            right.plot(
                [100 * level for level in LEVELS], held, "os"[k] + "-", color=colour, label=f"{r['modality']}: {answer}"
            )
    right.plot([50, 95], [50, 95], "k:", lw=1)
    right.set(xlabel="points an interval should hold, %", ylabel="points it holds, %", title="Error bars")
    right.legend(fontsize=8)
    right.grid(True, alpha=0.3)
    plot.savefig(png, dpi=130)
    plt.close(plot)


def line(r: Record) -> str:
    """One record as text."""
    if r["who"] == "insiders":
        held = {level: [round(100 * part, 1) for part in parts] for level, parts in r["coverage"].items()}
        text = f"{r['modality']} insiders: error {100 * r['error']:.2f} %, {100 * r['flagged']:.1f} % flagged"
        text += f", on 101 points {r['finer']:.2f} times, intervals hold {held}"
        return f"{text}; {1e3 * r['map_s']:.1f} ms a map, {r['maps_per_s']:.0f} maps a second"
    text = f"{r['modality']} {r['who']}: AUC {r['auc']:.3f} by {r['told_by']}"
    return f"{text}, {100 * r['flagged']:.0f} % flagged, error {100 * r['error']:.1f} %"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
