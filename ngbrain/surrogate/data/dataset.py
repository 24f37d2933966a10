"""Data to learn from: squares with random stiffness, their waves or compression computed, each sample from a seed of its own.

Two ways to look at a square, in plane strain:

waves        one edge shaken as a whole at 30 to 80 Hz, the others free, 120 mm across; both components, complex. Half of the
             squares are nearly incompressible, a quarter has no loss
compression  the top pushed down by 1 % on a slippery plate, the bottom held, 40 mm across; the axial component alone, as
             ultrasound sees it. It knows E up to one factor

Elements are of fourth order, on another mesh than the points that data are given at.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import ngsolve as ngs
import numpy as np
from scipy.ndimage import map_coordinates

from ngbrain import parallel
from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, file_context, nearest
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.io.finished import FinishedWork
from ngbrain.io.hdf5 import hdf5_image
from ngbrain.io.versions import versions
from ngbrain.materials import Shearing
from ngbrain.mesh.geometry.structured import rectangles
from ngbrain.progress import log_progress, reporting
from ngbrain.reading_hdf5 import hdf5
from ngbrain.surrogate.data.random_fields import FAMILIES, family

Array = np.ndarray
SPLITS = ("train", "validation", "test")
CELLS, ORDER, FINE = 16, 4, 201
"""Elements across, their order, and points across that moduli are drawn at, linear between."""
DENSITY = 1000.0
FREQUENCY, SHEAR, LOSS = (30.0, 80.0), (3e3, 1.2e4), (0.05, 0.5)
"""Hz; storage modulus of the background (Pa); loss over storage, of what has a loss."""
COMPRESSIBLE, NEARLY = (0.2, 0.45), (0.49, 0.4999)
"""Poisson's ratio."""
BLOCK = 25
"""Samples that one task computes."""


@dataclass(frozen=True)
class Sample:
    """One square: displacement (n, n, components) in m and moduli (n, n) in Pa, first axis y.

    storage and loss are G′ and G″ of waves, or E and 0 of compression; frequency in Hz.
    """

    displacement: Array
    storage: Array
    loss: Array
    frequency: float
    poisson: float


def waves(random: np.random.Generator, relative: Array, across: int) -> Sample:
    """A square shaken at one edge; see the module.

    relative  (FINE, FINE), storage modulus over that of the background
    across    points along an edge that are wanted
    """
    frequency = random.uniform(*FREQUENCY)
    storage = np.exp(random.uniform(*np.log(SHEAR))) * relative
    loss = 0.0 if random.random() < 0.25 else random.uniform(*LOSS) * storage * relative ** random.uniform(-0.5, 0.5)
    poisson = random.uniform(*(COMPRESSIBLE if random.random() < 0.5 else NEARLY))
    angle = random.uniform(0, 2 * np.pi)
    drive = {"top": (1e-3 * np.cos(angle), 1e-3 * np.sin(angle))}
    u = solve_displacement(storage + 1j * loss, frequency, poisson, drive, across)
    return Sample(u, _at(storage, across), _at(np.broadcast_to(loss, storage.shape), across), frequency, poisson)


def compression(random: np.random.Generator, relative: Array, across: int) -> Sample:
    """A square pushed down by a plate; see the module. Real."""
    poisson = random.uniform(*(COMPRESSIBLE if random.random() < 0.5 else NEARLY))
    youngs = 1e4 * relative
    side = SIDES["compression"]
    held = {"x": "bottom", "y": "bottom|top"}
    u = solve_displacement(youngs / (2 * (1 + poisson)), 0.0, poisson, {"top": (0, -0.01 * side)}, across, held, side)
    return Sample(u.real[..., 1:], _at(youngs, across), np.zeros((across, across)), 0.0, poisson)


MODALITIES: dict[str, Callable[[np.random.Generator, Array, int], Sample]] = {
    "waves": waves,
    "compression": compression,
}
SIDES = {"waves": 0.12, "compression": 0.04}
"""m, an edge of the square."""


def solve_displacement(
    shear: Array,
    frequency: float,
    poisson: float,
    drive: Mapping[str, Sequence[complex]],
    across: int,
    held: str | Mapping[str, str] | None = None,
    side: float = SIDES["waves"],
) -> Array:
    """Displacement (across, across, 2) in m of a square with shear modulus G (n, n) in Pa, real or complex, rows along y.

    drive  edge → displacement (m)
    held   edges that are held, by component if need be; by default those that are driven

    Raises `SolverError` at a resonance without loss.

    >>> u = solve_displacement(np.full((5, 5), 5e3 + 1e3j), 50.0, 0.3, {"top": (1e-3, 0)}, 11)
    >>> u.shape, bool(np.allclose(u[-1], [1e-3, 0]))
    ((11, 11, 2), True)
    """
    mesh, points = _square(side, across)
    spread = ngs.VoxelCoefficient((0, 0), (side, side), np.asarray(shear, complex), linear=True)
    bulk = 2 * (1 + poisson) / (3 * (1 - 2 * poisson)) * spread
    form = f"P{ORDER}/P{ORDER - 1}" if poisson > 0.45 else f"P{ORDER}"
    body = HarmonicProblem(
        mesh,
        Shearing(spread),
        [Wave(frequency, drive)],
        bulk=bulk,
        density=DENSITY,
        form=form,
        held=held or "|".join(drive),
    )
    (gfu,) = body.solve()
    return np.asarray(body.split(gfu)[0](points)).reshape(across, across, 2)


def sample(modality: str, name: str, seed: int, split: str, index: int, across: int) -> Sample:
    """Sample `index` of a family; seeds of splits, families and samples never meet. Raises `InputError` for names that are none.

    >>> one, same = (sample("compression", "sinc", 0, "test", 3, 11) for _ in range(2))
    >>> one.displacement.shape, bool(np.allclose(one.displacement, same.displacement, rtol=1e-9))
    ((11, 11, 1), True)
    """
    for field, value, known in (("modality", modality, list(MODALITIES)), ("split", split, list(SPLITS))):
        if value not in known:
            raise InputError(field, repr(value), nearest(value, known))
    key = (list(MODALITIES).index(modality), list(FAMILIES).index(name), SPLITS.index(split), index)
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, FINE),), indexing="ij")
    return MODALITIES[modality](random, family(name)(random, x, y), across)


@reporting()
def generate(
    path: Path,
    modality: str,
    families: Mapping[str, int],
    split: str,
    seed: int = 0,
    across: int = 51,
    executor: parallel.AnyExecutor = None,
    callback: parallel.Callback = log_progress,
) -> None:
    """Compute samples of each family (name → how many) and write them to an HDF5 file, whole or not at all.

    Datasets, a row for each sample: displacement, storage, loss, frequency, poisson, family (a number; names in the attribute
    `families`). Attributes: modality, split, seed, side (m), sha256 of what is in it, and the versions of what computed.

    Blocks of samples are tasks of an executor (`parallel.run`). They are kept in a folder beside the file until it is written, so
    that a run that was stopped goes on.

    Raises `InputError` for names that are none, `SolverError` where no field was found.
    """
    tasks: list[parallel.Task] = []
    for name, count in families.items():
        family(name)
        for first in range(0, count, BLOCK):
            ids = range(first, min(first + BLOCK, count))
            tasks.append(parallel.Task(f"{name} {first}", _block, (modality, name, seed, split, ids, across)))
    work = FinishedWork(path.with_name(f"{path.stem}_blocks"))
    blocks = list(parallel.run(tasks, executor, callback=callback, store=work).values())
    columns = {key: np.concatenate([block[key] for block in blocks]) for key in blocks[0]}
    columns["family"] = np.concatenate([np.full(count, i) for i, count in enumerate(families.values())])
    told = {"modality": modality, "split": split, "seed": seed, "side": SIDES[modality], "families": list(families)}
    told |= {f"version_{name}": number for name, number in versions().items()}

    def fill(file: h5py.File) -> None:
        for key, values in columns.items():
            file.create_dataset(key, data=values)
        file.attrs.update(told | {"sha256": digest(columns)})

    image = hdf5_image(fill)
    atomic_write(path, lambda part: part.write_bytes(image))
    shutil.rmtree(work.folder)


def _block(
    modality: str, name: str, seed: int, split: str, ids: Sequence[int], across: int, callback: parallel.Callback
) -> dict[str, Array]:
    rows = [sample(modality, name, seed, split, index, across) for index in ids]
    callback(name, ids[-1], 1.0)
    kind = np.complex64 if rows[0].displacement.dtype.kind == "c" else np.float32
    return {
        "displacement": np.array([row.displacement for row in rows], kind),
        "storage": np.array([row.storage for row in rows], np.float32),
        "loss": np.array([row.loss for row in rows], np.float32),
        "frequency": np.array([row.frequency for row in rows]),
        "poisson": np.array([row.poisson for row in rows]),
    }


@dataclass(frozen=True, eq=False)
class DataSet:
    """What `generate` has written, in memory; `names` are its families."""

    modality: str
    split: str
    side: float
    sha256: str
    names: tuple[str, ...]
    displacement: Array
    storage: Array
    loss: Array
    frequency: Array
    poisson: Array
    family: Array

    def __len__(self) -> int:
        return len(self.displacement)

    @staticmethod
    def read(path: Path) -> DataSet:
        """From a file; `InputError` where it is none of `generate`'s, or not what was written."""
        with file_context(path):
            try:
                with hdf5(path, "file") as file:
                    columns: dict[str, Any] = {key: file[key][:] for key in COLUMNS}
                    told = {key: file.attrs[key] for key in ("modality", "split", "side", "sha256", "families")}
            except (KeyError, TypeError, ValueError) as error:
                raise InputError(
                    "file", f"without {error}", "data that `ngbrain.surrogate.data.dataset` has written"
                ) from error
            if digest(columns) != told["sha256"]:
                raise InputError("sha256", "not that of the data", "a file that nobody has changed")
        return DataSet(names=tuple(told.pop("families")), **told, **columns)


COLUMNS = ("displacement", "storage", "loss", "frequency", "poisson", "family")


def digest(columns: Mapping[str, Array]) -> str:
    """SHA-256 of arrays by name, in the order of `COLUMNS`."""
    total = hashlib.sha256()
    for key in COLUMNS:
        total.update(np.ascontiguousarray(columns[key]).tobytes())
    return total.hexdigest()


@cache
def _square(side: float, across: int) -> tuple[ngs.Mesh, Array]:
    """The mesh, and places in it, rows along y."""
    lines = np.linspace(0, side, CELLS + 1)
    mesh = rectangles(lines, lines)
    y, x = np.meshgrid(*2 * (np.linspace(0, side, across),), indexing="ij")
    return mesh, mesh(x.ravel(), y.ravel())


def _at(fine: Array, across: int) -> Array:
    """Of an array on `FINE` points, linear between them, the values at `across` points."""
    places = np.linspace(0, FINE - 1, across)
    return map_coordinates(fine, np.meshgrid(places, places, indexing="ij"), order=1)
