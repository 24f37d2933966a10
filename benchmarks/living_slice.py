"""A measured brain: one axial slice with through-plane motion, 30 to 60 Hz, inverted by the command line with default options.

FILE is MRE_demo_data.mat of https://github.com/aaronfeng369/Brain_actuator (figure14; Qiu et al. 2021, 10.1002/nbm.4592): the
displacement at four times of a period, and the authors' map of the shear modulus by local frequency estimation (kPa). Pixels of
1.25 mm are assumed from the brain's length. Of each frequency alone and of all together: G' over the authors' map at points 10 mm
or more inside of the mask, its median; Spearman's rank correlation of both there, smoothed by a Gaussian of 5 mm (standard
deviation); and the same of plain Helmholtz inversion of a smooth field, and of our own local frequency estimation, which is the
authors' method: what that has is the file's convention and the pixels, what the others have beyond it is the method.
`wavelengths` says what the displacements themselves have, without any inversion: half of their energy is in waves longer than
`median_mm` in the plane, `shorter` of it in waves as short as the authors' modulus has, `authors_mm`, or shorter.

`against` puts the authors' own map, times factors and with one loss tangent that is scanned, into the equation that is asked for,
∇·(G*∇u) = -ρω²u with the displacement of the rim and a uniform one unknown: what part (rms) of the displacement is left, in the
elements of our inversion, which say the same of our own map. Once more where smooth sources are unknown too, all cosines of a
wavelength of `LONG` or more: of waves that leave the slice G ∂²u/∂z² and the pressure's gradient are such ones. Where no factor
from .75 to 1.33 leaves as little as the images' noise, no answer of that equation to these data is that map.

    python benchmarks/living_slice.py FILE [--only HZ|all ...] [--json] [--executor WHO]      last line of --json: a list of records
    python benchmarks/living_slice.py --chart FILE.png < records.json
    python benchmarks/living_slice.py --exponent < records.json      of frequencies that were inverted one by one
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import ngsolve as ngs
import numpy as np
import scipy.io
from _command import add_executor, executor_of, run, sweep
from _front import figure
from scipy import ndimage
from scipy.stats import spearmanr, t

from ngbrain import parallel
from ngbrain.cli import main as ngbrain
from ngbrain.inverse import (
    ElastographyProblem,
    discretise,
    field_observations,
    fit_field,
    helmholtz,
    local_frequency,
    screen_outliers,
)
from ngbrain.inverse import smooth as gradients
from ngbrain.io import WaveData, read_waves
from ngbrain.threads import set_threads

Record = dict
FREQUENCIES = (30.0, 40.0, 50.0, 60.0)
CHOICES = {**{f"{hz:g}": [i] for i, hz in enumerate(FREQUENCIES)}, "all": list(range(len(FREQUENCIES)))}
PIXEL, DEEP, SMOOTH, TAPER = 1.25e-3, 10e-3, 5e-3, 20e-3
DENSITY = 1000.0
THROUGH = 2
"""The measured through-plane component."""
STIFFEST = 20e3
"""Upper limit (Pa) of Helmholtz inversion before smoothing."""
FACTORS, TANGENTS = (0.5, 0.75, 1.0, 1.33, 2.0, 3.0, 4.0), (0.02, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
"""Factors on the authors' map, and loss tangents."""
LONG = 60e-3
"""Wavelength (m) in the plane of the shortest unknown sources; the authors' modulus has waves of 22 to 34 mm."""


class Slice:
    """The file, cropped to the brain: samples (x, y, times, frequencies) m, the authors' map (x, y, frequencies) Pa, mask."""

    def __init__(self, path: Path) -> None:
        file = scipy.io.loadmat(path)
        moved, modulus = file["displacement"][:, :, 0, :, THROUGH], file["MU_2d_smoothed"][:, :, 0, THROUGH]
        mask = (moved != 0).any(axis=(2, 3))
        (around,) = ndimage.find_objects(mask.astype(int))
        self.samples, self.authors, self.mask = moved[around], 1e3 * modulus[around], mask[around]
        self.deep = ndimage.distance_transform_edt(np.pad(self.mask, 1))[1:-1, 1:-1] * PIXEL > DEEP

    def write(self, path: Path, chosen: list[int]) -> None:
        """Wave data of these frequencies."""
        samples = np.moveaxis(self.samples[..., chosen], 3, 2)  # (x, y, loads, times)
        np.savez(
            path,
            samples=samples[:, :, None, :, None],
            spacing=PIXEL,
            frequency=[FREQUENCIES[i] for i in chosen],
            density=DENSITY,
            symmetry="isotropic",
            rheology="viscoelastic",
            motion="anti_plane",
            tissue="brain",
            mask=self.mask[:, :, None],
        )

    def compared(self, storage: np.ndarray, which: int) -> tuple[float, float]:
        """Median ratio of a map (x, y) to the authors' inside, and the rank correlation of both when they are smooth."""
        known = self.mask & np.isfinite(storage) & np.isfinite(self.authors[..., which])
        inside = known & self.deep
        ratio = float(np.median(storage[inside] / self.authors[..., which][inside]))
        ours, theirs = (smooth(np.where(known, each, 0), known) for each in (storage, self.authors[..., which]))
        return ratio, float(spearmanr(ours[inside], theirs[inside]).statistic)

    def wavelengths(self, which: int) -> Record:
        """In the plane, of the displacements' energy at one frequency (tapered over 2 cm from the border, mean subtracted)."""
        wave = np.fft.fft(self.samples[..., which], axis=2)[..., 1]
        ramp = np.clip(ndimage.distance_transform_edt(np.pad(self.mask, 1))[1:-1, 1:-1] * PIXEL / TAPER, 0, 1)
        taper = np.sin(ramp * np.pi / 2) ** 2
        wave = taper * (wave - np.sum(taper * wave) / taper.sum())
        size = [2 * n for n in wave.shape]
        energy = np.abs(np.fft.fft2(wave, size)) ** 2
        per_metre = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n, PIXEL) for n in size), indexing="ij"))
        order = np.argsort(per_metre, axis=None)
        share = np.cumsum(energy.ravel()[order]) / energy.sum()
        middle = per_metre.ravel()[order][np.searchsorted(share, 0.5)]
        theirs = np.sqrt(np.nanmedian(self.authors[..., which][self.mask & self.deep]) / DENSITY) / FREQUENCIES[which]
        shorter = float(energy[per_metre >= 1 / theirs].sum() / energy.sum())
        return {"median_mm": float(1e3 / middle), "authors_mm": float(1e3 * theirs), "shorter": shorter}


class Against:
    """Residual of the displacement at one frequency for given modulus maps."""

    def __init__(self, data: WaveData) -> None:
        self.data = screen_outliers(data).data
        self.experiment = ElastographyProblem(self.data, discretise(self.data))
        self.unknowns = self.experiment.unknowns(np.ones(1))
        self.sources = list(self._sources())

    def _sources(self) -> Iterator[np.ndarray]:
        """∫ φ v of cosines over the box around the mask, but the constant one, which is a translation."""
        inside = self.data.points[self.experiment.inside]
        low, size = inside.min(axis=0), np.ptp(inside, axis=0)
        test = self.experiment.body.split(self.experiment.body.fes.TestFunction())[0]
        for a, b in np.ndindex(*(int(2 * each / LONG) + 1 for each in size)):
            if 0 < np.hypot(a / size[0], b / size[1]) / 2 <= 1 / LONG:
                load, shape = ngs.LinearForm(self.experiment.body.fes), ngs.CF(1.0)
                for n, x, start, side in zip((a, b), (ngs.x, ngs.y), low, size, strict=True):
                    shape = shape * ngs.cos(np.pi * n * (x - start) / side) if n else shape
                load += shape * test * ngs.dx(bonus_intorder=8)
                load.Assemble()
                yield load.vec.FV().NumPy().copy()

    def left(self, storage: np.ndarray, loss: np.ndarray) -> tuple[float, float]:
        """Of the displacement (rms over its own), rim and translation unknown; and with sources. Moduli (n,) at the points, Pa."""
        x, model = self.unknowns.start.copy(), self.experiment.model
        for field, _, at, values in field_observations(
            self.experiment, {"storage": np.log(storage), "loss": np.log(loss)}
        ):
            block = self.unknowns.blocks[field.name]
            x[block] = fit_field(at, values, gradients(self.experiment.space, self.unknowns.start[block]), x[block])
        factors, columns = model.evaluate(self.unknowns.theta(x)).factors, []
        for driven in model.driven_dofs:
            held = np.zeros(self.experiment.body.fes.ndof, complex)
            held[driven] = 1
            columns.append(model.observe(factors.solve_wave(0, held))[:, 0])
        moved = [model.observe(factors.solve(0, source))[:, 0] for source in self.sources]
        columns += [each / np.abs(each).max() for each in moved]
        measured = self.experiment.measured[0, :, 0]
        known = np.isfinite(measured)
        matrix, right = np.array(columns).T[known], measured[known]
        parts = [matrix[:, : len(model.driven_dofs)], matrix]
        off = [right - part @ np.linalg.lstsq(part, right, rcond=1e-10)[0] for part in parts]
        return tuple(float(np.linalg.norm(each) / np.linalg.norm(right)) for each in off)  # type: ignore[return-value]


def against(known: Slice, which: int, data: WaveData, storage: np.ndarray, loss: np.ndarray) -> Record:
    """Residual of the authors' map times factors, the smallest over loss tangents; and that of our own map."""
    judge, grid = Against(data), data.grid
    assert grid is not None
    theirs = grid.flat(known.authors[..., which])
    theirs = np.where(data.mask & (theirs > 0), theirs, np.nan)
    found = {f: [judge.left(f * theirs, f * tangent * theirs) for tangent in TANGENTS] for f in FACTORS}
    best = {f: np.argmin(each, axis=0) for f, each in found.items()}
    ours = judge.left(storage, loss)
    return {
        "factors": list(FACTORS),
        "rim": {
            "left": [found[f][best[f][0]][0] for f in FACTORS],
            "tangent": [TANGENTS[best[f][0]] for f in FACTORS],
            "ours": ours[0],
            "unknowns": len(judge.experiment.model.driven_dofs),
        },
        "sources": {
            "left": [found[f][best[f][1]][1] for f in FACTORS],
            "tangent": [TANGENTS[best[f][1]] for f in FACTORS],
            "ours": ours[1],
            "unknowns": len(judge.experiment.model.driven_dofs) + len(judge.sources),
        },
        "longest_mm": 1e3 * LONG,
    }


def smooth(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Smooth by a Gaussian over the known points."""
    weight = ndimage.gaussian_filter(known.astype(float), SMOOTH / PIXEL)
    return ndimage.gaussian_filter(values, SMOOTH / PIXEL) / np.maximum(weight, 1e-9)


def measure(path: Path, names: list[str], executor: parallel.AnyExecutor = None) -> list[Record]:
    """One record for each selected item of `CHOICES`."""
    known = Slice(path)
    return sweep(record, {name: (known, CHOICES[name]) for name in names}, executor)


def record(known: Slice, chosen: list[int]) -> Record:
    """Record of `ngbrain invert` with default options for these frequencies."""
    with tempfile.TemporaryDirectory() as place:
        file, folder = Path(place) / "slice.npz", Path(place) / "inverted"
        known.write(file, chosen)
        begun = time.process_time()
        status = ngbrain(["invert", str(file), "-o", str(folder), "-q"])
        cpu_s = time.process_time() - begun
        found: Record = {"frequency": [FREQUENCIES[i] for i in chosen], "status": status, "cpu_s": cpu_s}
        if not (folder / "result.json").exists():
            return found
        result = json.loads((folder / "result.json").read_text())
        storage, loss = (np.load(folder / "maps.npz")[name] for name in ("storage", "loss"))
        data = read_waves(file)
    grid = data.grid
    assert grid is not None
    ratio, rank = known.compared(grid.box(storage), chosen[0])
    found |= {"ratio": ratio, "rank": rank, "storage": float(np.nanmedian(storage)), "loss": float(np.nanmedian(loss))}
    plain = grid.box(helmholtz(data).real)
    found["helmholtz_ratio"], found["helmholtz_rank"] = known.compared(
        np.where(np.isfinite(plain), np.clip(plain, 0, STIFFEST), np.nan), chosen[0]
    )
    lfe = grid.box(local_frequency(data).real)
    found["wavelengths"] = known.wavelengths(chosen[0])
    found["lfe_ratio"], found["lfe_rank"] = known.compared(lfe, chosen[0])
    if len(chosen) == 1:
        found["against"] = against(known, chosen[0], data, storage, loss)
    for name in ("usable", "reasons", "warnings", "checks", "noise", "selected_start"):
        found[name] = result[name]
    found["regulariser"], found["form"] = result["model"]["regulariser"], result["model"]["form"]
    found["elements"], found["effective_dof"] = result["model"]["n_elements"], result["model"]["effective_dof"]
    return found


def chart(records: list[Record], png: str) -> None:
    """Residual against the factor on the authors' map, with the noise of the images."""
    shown = [r for r in records if "against" in r]
    plt, made, panels = figure(7.6, 3.4, 2, sharey=True)
    titles = {"rim": "rim unknown", "sources": f"and sources of {1e3 * LONG:g} mm or longer"}
    for axes, (kind, title) in zip(panels, titles.items(), strict=True):
        axes.axvspan(0.75, 1.33, color="#f2d35b", alpha=0.4, lw=0)
        for r in shown:
            told = r["against"]
            (curve,) = axes.plot(told["factors"], told[kind]["left"], "o-", ms=3.5, label=f"{r['frequency'][0]:g} Hz")
            axes.axhline(r["noise"]["stated"], color=curve.get_color(), lw=0.8, ls=":")
        axes.set(xscale="log", xlabel="factor on the authors' map", title=title, ylim=(0, 0.9))
        axes.set_xticks(FACTORS, [f"{f:g}" for f in FACTORS])
        axes.minorticks_off()
        axes.grid(alpha=0.25, lw=0.6)
    panels[0].set_ylabel("part of the displacement that is left")
    made.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    made.savefig(png, dpi=130)
    plt.close(made)


def exponent(records: list[Record]) -> str:
    """Slope of ln |G*| (medians) over ln f of frequencies inverted one by one, its 95 % interval, and without one of them."""
    alone = [r for r in records if len(r["frequency"]) == 1 and "storage" in r]
    x, y = (
        np.log(each)
        for each in ([r["frequency"][0] for r in alone], [np.hypot(r["storage"], r["loss"]) for r in alone])
    )
    (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
    reach = t.ppf(0.975, len(x) - 2) * np.sqrt(covariance[0, 0])
    without = [np.polyfit(np.delete(x, i), np.delete(y, i), 1)[0] for i in range(len(x))]
    ends = f"{slope - reach:.2f} to {slope + reach:.2f}"
    return f"{slope:.2f}, 95 % {ends}; without one of them {min(without):.2f} to {max(without):.2f}"


def line(r: Record) -> str:
    """One record as text."""
    which = ", ".join(f"{f:g}" for f in r["frequency"])
    if "ratio" not in r:
        return f"{which} Hz: exit {r['status']}"
    exponent = r["checks"].get("exponent")
    power = "" if exponent is None else f", exponent {exponent:.2f}"
    beside = ", ".join(
        f"{name} {r[f'{key}_ratio']:.2f}, {r[f'{key}_rank']:.2f}"
        for key, name in (("helmholtz", "Helmholtz"), ("lfe", "local frequency"))
    )
    return (
        f"{which} Hz: G' over the authors' {r['ratio']:.2f}, rank {r['rank']:.2f} ({beside}), {1e-3 * r['storage']:.2f} + "
        f"{1e-3 * r['loss']:.2f}i kPa{power}, exit {r['status']}, {r['cpu_s']:.0f} s of CPU time"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, metavar="FILE", nargs="?")
    parser.add_argument("--only", nargs="+", choices=CHOICES, default=list(CHOICES), metavar="HZ")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--chart", metavar="PNG")
    parser.add_argument("--exponent", action="store_true")
    add_executor(parser)
    arguments = parser.parse_args()
    if arguments.exponent:
        print(exponent(json.loads(sys.stdin.read().strip().splitlines()[-1])))
        sys.exit()
    if arguments.chart:
        chart(json.loads(sys.stdin.read().strip().splitlines()[-1]), arguments.chart)
        sys.exit()
    if arguments.file is None:
        parser.error("FILE is missing")
    if not arguments.file.exists():
        print(f"skipped: {arguments.file.name} is not there")
        sys.exit()
    set_threads(1)
    ngs.ngsglobals.msg_level = 0
    with executor_of(parser, arguments.executor) as workers:
        records, made = measure(arguments.file, arguments.only, workers), run()
    print(json.dumps([r | {"run": made} for r in records]) if arguments.json else "\n".join(map(line, records)))
