"""What `ngbrain data` brings: waves, ultrasound, a retraction; made on other elements than are inverted in, with seeded noise.

In the plane elements are triangles of fifth order (an inversion takes quadrilaterals of third), in space tetrahedra of fourth (an
inversion takes hexahedra of second or third); those of the retraction are a fifth smaller. Waves carry their true moduli.

    python benchmarks/_samples.py [NAME ...] [-o DIR]      DIR is ngbrain/samples by default
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
from _bodies import sampled
from inversion_retraction import FINER, NOISE, noisy, observed, operation

from ngbrain.forward import HarmonicProblem, Wave
from ngbrain.io import WaveData, write_waves
from ngbrain.materials import Shearing
from ngbrain.surgery import RetractionModel, observations

SHIPPED = Path(__file__).parents[1] / "ngbrain" / "samples"
DENSITY, SEED = 1000.0, 20260101


def waves_plane() -> WaveData:
    """A slice of 72 by 72 mm in plane strain, its top shaken at 60 Hz, aside and up and down; 31 by 31 points, 2 % noise.

    G* = 3 + 0.9i kPa, with a lump of up to twice that and a soft spot of down to 0.7 times.
    """
    side, hertz, poisson = 0.072, 60.0, 0.49

    def shear(x, y, exp):  # type: ignore[no-untyped-def]
        def spot(height, across, up):  # type: ignore[no-untyped-def]
            return height * exp(-((x - across * side) ** 2 + (y - up * side) ** 2) / (2 * (0.12 * side) ** 2))

        return (3000 + 900j) * (1 + spot(1.0, 0.6, 0.45) + spot(-0.3, 0.25, 0.7))

    modulus = shear(ngs.x, ngs.y, ngs.exp)
    drives = [{"top": (1e-5, 0)}, {"top": (0, 1e-5)}]
    body = HarmonicProblem(
        square(side, 8e-3),
        Shearing(modulus),
        [Wave(hertz, drive) for drive in drives],
        bulk=bulk_of(modulus, poisson),
        density=DENSITY,
        form="P5/P4",
        dirichlet="top",
    )
    points = grid(np.linspace(0, side, 31), 2)
    return WaveData(
        points,
        sampled(body, points),
        [hertz] * 2,
        DENSITY,
        "isotropic",
        "viscoelastic",
        poisson=poisson,
        truth={"shear": shear(*points.T, np.exp)},
    ).with_noise(0.02, SEED)


def waves_space() -> WaveData:
    """The inner 39 mm of a block of 60 mm, driven at 60 Hz along x at its bottom, then along y at its left.

    A point every 3 mm, 2 % noise. G* = 3 + 1i kPa, with a lump of up to twice that.
    """
    side, hertz, bulk, centre, width = 0.060, 60.0, 2e5, np.array([0.031, 0.029, 0.030]), 7e-3

    def shear(squared, exp):  # type: ignore[no-untyped-def]
        return (3000 + 1000j) * (1 + exp(-squared / (2 * width**2)))

    box = occ.Box((0, 0, 0), (side, side, side))
    box.faces.name = "free"
    box.faces.Min(occ.Z).name, box.faces.Min(occ.X).name = "bottom", "left"
    mesh = ngs.Mesh(occ.OCCGeometry(box).GenerateMesh(maxh=0.012))
    away = sum((axis - c) ** 2 for axis, c in zip((ngs.x, ngs.y, ngs.z), centre, strict=True))
    points = grid(np.arange(10.5e-3, side - 10e-3, 3e-3), 3)
    at, waves = mesh(*points.T), []
    for face, drive in (("bottom", (1e-5, 0, 0)), ("left", (0, 1e-5, 0))):
        load = Wave(hertz, {face: drive})
        law = Shearing(shear(away, ngs.exp))
        (wave,) = HarmonicProblem(mesh, law, [load], bulk=bulk, density=DENSITY, form="P4", dirichlet=face).solve()
        waves.append(wave(at))
    return WaveData(
        points,
        np.array(waves),
        [hertz] * 2,
        DENSITY,
        "isotropic",
        "viscoelastic",
        bulk=bulk,
        truth={"shear": shear(((points - centre) ** 2).sum(axis=1), np.exp)},
    ).with_noise(0.02, SEED)


def ultrasound() -> WaveData:
    """A square of 40 mm compressed by 0.4 mm with a frictionless plate; the axial (y) displacement only, 0.15 % noise.

    E = 10 kPa, three times as much in a round lesion of 10 mm whose edge fades over 1 mm.
    """
    side, poisson, radius, fade, noise = 0.04, 0.495, 5e-3, 5e-4, 0.0015

    def youngs(x, y, exp, sqrt):  # type: ignore[no-untyped-def]
        away = sqrt((x - 0.021) ** 2 + (y - 0.022) ** 2)
        return 1e4 * (1 + 2 / (1 + exp((away - radius) / fade)))

    shear = youngs(ngs.x, ngs.y, ngs.exp, ngs.sqrt) / (2 * (1 + poisson))
    body = HarmonicProblem(
        square(side, 1.5e-3),
        Shearing(shear * (1 + 0j)),
        [Wave(0.0, {"top": (0, -0.01 * side)})],
        bulk=bulk_of(shear, poisson),
        form="P5/P4",
        dirichlet={"x": "bottom", "y": "bottom|top"},
    )
    points = grid(np.linspace(0, side, 41), 2)
    u = sampled(body, points).real
    u[:, :, 0] = np.nan
    exact = WaveData(
        points,
        u,
        [0.0],
        DENSITY,
        "isotropic",
        "elastic",
        poisson=poisson,
        truth={"youngs": youngs(*points.T, np.exp, np.sqrt)},
    )
    noisy = exact.with_noise(np.sqrt(2) * noise, SEED)  # half of whose power is imaginary, of which ultrasound has none
    return replace(noisy, displacement=noisy.displacement.real, noise=noise)


def retraction(folder: Path) -> None:
    """A retraction of the idealised head by 3 mm in 5 s, held for 5 s, as a scene; and its measurements with 1 % noise.

    In truth the cortex is 1.5 and white matter 0.7 times as stiff as in the scene.
    """
    name, stages, tolerance, elapsed = "idealised_fast", (2.5, 5.0, 7.5, 10.0), 0.05, 10.0
    scene = replace(operation(name, 1.0, tolerance, elapsed), title="A short retraction of an idealised head, coarse")
    seen = noisy(
        observed(name, RetractionModel.from_scene(operation(name, FINER, tolerance / 3, elapsed)), stages), NOISE[0]
    )
    moved = [
        [t, *1e3 * where, *1e3 * way]
        for t, ways in zip(seen.times, seen.displacements, strict=True)
        for where, way in zip(seen.landmarks, ways, strict=True)
    ]
    print(f"standard deviations: {1e3 * seen.sigma[0]:.2g} mm, {seen.sigma[1]:.2g} N")
    tables = {
        "landmarks": (observations.LANDMARKS, moved),
        "force": (observations.FORCE, zip(seen.times, seen.force, strict=True)),
    }
    for table, (columns, rows) in tables.items():
        lines = [",".join(columns), *(",".join(f"{value:.6g}" for value in row) for row in rows)]
        (folder / f"retraction_{table}.csv").write_text("\n".join(lines) + "\n")
    (folder / "retraction.toml").write_text(scene.to_toml())


WAVES: dict[str, Callable[[], WaveData]] = {each.__name__: each for each in (waves_plane, waves_space, ultrasound)}


def square(side: float, size: float) -> ngs.Mesh:
    """A triangle mesh; its edges are bottom, top and sides."""
    face = occ.Rectangle(side, side).Face()
    face.edges.name = "sides"
    face.edges.Max(occ.Y).name, face.edges.Min(occ.Y).name = "top", "bottom"
    return ngs.Mesh(occ.OCCGeometry(face, dim=2).GenerateMesh(maxh=size))


def grid(line: np.ndarray, dim: int) -> np.ndarray:
    """Points numbered along x first."""
    return np.stack(np.meshgrid(*[line] * dim, indexing="ij"), axis=-1).reshape(-1, dim)[:, ::-1]


def bulk_of(shear, poisson: float):  # type: ignore[no-untyped-def]
    """Bulk modulus of a shear modulus."""
    return 2 * (1 + poisson) / (3 * (1 - 2 * poisson)) * shear


def rounded(data: WaveData) -> WaveData:
    """Displacements and truth in seven digits, far below the noise, which halves the files."""

    def single(values: np.ndarray) -> np.ndarray:
        return values.astype(np.complex64 if np.iscomplexobj(values) else np.float32).astype(values.dtype)

    truth = {name: single(values) for name, values in data.truth.items()}
    return replace(data, displacement=single(data.displacement), truth=truth)


if __name__ == "__main__":
    known = [*WAVES, retraction.__name__]
    parser = argparse.ArgumentParser(description="Make the sample data of `ngbrain data` anew.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(known))
    parser.add_argument("-o", dest="folder", type=Path, default=SHIPPED, metavar="DIR")
    given = parser.parse_args()
    ngs.SetNumThreads(1)
    for name in given.names or known:
        if name in WAVES:
            write_waves(given.folder / f"{name}.npz", rounded(WAVES[name]()))
        else:
            retraction(given.folder)
