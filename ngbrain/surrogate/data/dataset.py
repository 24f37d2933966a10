"""Training data: squares of random stiffness with computed waves or compression, each sample from its own seed.

Two modalities, in plane strain:

waves        one edge moves as a rigid body at 30 to 80 Hz, the others are free; 120 mm across; both components, complex. Half
             of the squares are nearly incompressible, a quarter has no loss
compression  the top is displaced by 1 % by a frictionless plate, the bottom is fixed; 40 mm across; only the axial component, as
             ultrasound measures it. It determines E up to a constant factor

Elements are of fourth order, on another mesh than the points at which data are given.
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
from ngbrain.look import BriefText
from ngbrain.materials import Shearing
from ngbrain.mesh.geometry.structured import rectangles
from ngbrain.progress import log_progress, reporting
from ngbrain.reading.hdf5 import hdf5
from ngbrain.surrogate.data.random_fields import FAMILIES, family

Array = np.ndarray
SPLITS = ("train", "validation", "test")
CELLS, ORDER, FINE = 16, 4, 201
"""Elements across, their order, and points across at which moduli are given, with linear interpolation."""
DENSITY = 1000.0
FREQUENCY, SHEAR, LOSS = (30.0, 80.0), (3e3, 1.2e4), (0.05, 0.5)
"""Frequency (Hz); storage modulus of the background (Pa); loss over storage modulus where there is a loss."""
COMPRESSIBLE, NEARLY = (0.2, 0.45), (0.49, 0.4999)
"""Poisson's ratio."""
BLOCK = 25
"""Samples per task."""


@dataclass(frozen=True, repr=False)
class Sample(BriefText):
    """One square of training data; arrays have y as first axis.

    Parameters
    ----------
    displacement : numpy.ndarray of shape (n, n, components)
        Displacement (m).
    storage : numpy.ndarray of shape (n, n)
        G′ of waves, or E of compression (Pa).
    loss : numpy.ndarray of shape (n, n)
        G″ of waves, or 0 (Pa).
    frequency : float
        Frequency (Hz).
    poisson : float
        Poisson's ratio.
    """

    displacement: Array
    storage: Array
    loss: Array
    frequency: float
    poisson: float


def waves(random: np.random.Generator, relative: Array, across: int) -> Sample:
    """Waves in a square with one driven edge; see the module.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    relative : numpy.ndarray of shape (FINE, FINE)
        Storage modulus relative to the background.
    across : int
        Points along an edge of the result.

    Returns
    -------
    Sample
        The sample.
    """
    frequency = random.uniform(*FREQUENCY)
    storage = np.exp(random.uniform(*np.log(SHEAR))) * relative
    loss = 0.0 if random.random() < 0.25 else random.uniform(*LOSS) * storage * relative ** random.uniform(-0.5, 0.5)
    poisson = random.uniform(*(COMPRESSIBLE if random.random() < 0.5 else NEARLY))
    angle = random.uniform(0, 2 * np.pi)
    drive = {"top": (1e-3 * np.cos(angle), 1e-3 * np.sin(angle))}
    u = solve_displacement(storage + 1j * loss, frequency, poisson, drive, across)
    return Sample(
        u, _interpolate(storage, across), _interpolate(np.broadcast_to(loss, storage.shape), across), frequency, poisson
    )


def compression(random: np.random.Generator, relative: Array, across: int) -> Sample:
    """Compression of a square by a frictionless plate, real; see the module.

    Parameters
    ----------
    random : np.random.Generator
        Random numbers.
    relative : numpy.ndarray of shape (FINE, FINE)
        Young's modulus relative to the background.
    across : int
        Points along an edge of the result.

    Returns
    -------
    Sample
        The sample.
    """
    poisson = random.uniform(*(COMPRESSIBLE if random.random() < 0.5 else NEARLY))
    youngs = 1e4 * relative
    side = SIDES["compression"]
    held = {"x": "bottom", "y": "bottom|top"}
    u = solve_displacement(youngs / (2 * (1 + poisson)), 0.0, poisson, {"top": (0, -0.01 * side)}, across, held, side)
    return Sample(u.real[..., 1:], _interpolate(youngs, across), np.zeros((across, across)), 0.0, poisson)


MODALITIES: dict[str, Callable[[np.random.Generator, Array, int], Sample]] = {
    "waves": waves,
    "compression": compression,
}
SIDES = {"waves": 0.12, "compression": 0.04}
"""Edge of the square (m)."""


def solve_displacement(
    shear: Array,
    frequency: float,
    poisson: float,
    drive: Mapping[str, Sequence[complex]],
    across: int,
    held: str | Mapping[str, str] | None = None,
    side: float = SIDES["waves"],
) -> Array:
    """Displacement of a square with prescribed displacements, at rest or in harmonic motion.

    Parameters
    ----------
    shear : numpy.ndarray of shape (n, n)
        Shear modulus G (Pa), real or complex, rows along y.
    frequency : float
        Frequency (Hz), 0 at rest.
    poisson : float
        Poisson's ratio.
    drive : dict of str to sequence of complex
        Edge → displacement (m).
    across : int
        Points along an edge of the result.
    held : str or dict of str to str, optional
        Edges with Dirichlet conditions, by component if need be; by default the driven edges.
    side : float, default SIDES['waves']
        Edge of the square (m).

    Returns
    -------
    numpy.ndarray of shape (across, across, 2)
        Displacement (m).

    Raises
    ------
    SolverError
        A resonance without loss.

    Examples
    --------
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
        dirichlet=held or "|".join(drive),
    )
    (gfu,) = body.solve()
    return np.asarray(body.split(gfu)[0](points)).reshape(across, across, 2)


def sample(modality: str, name: str, seed: int, split: str, index: int, across: int) -> Sample:
    """Sample number `index` of a family; seeds of splits, families and samples are distinct.

    Parameters
    ----------
    modality : str
        "waves" or "compression".
    name : str
        Family.
    seed : int
        Seed of the data set.
    split : str
        "train", "validation" or "test".
    index : int
        Number of the sample.
    across : int
        Points along an edge.

    Returns
    -------
    Sample
        The sample.

    Raises
    ------
    InputError
        An unknown modality, family or split.

    Examples
    --------
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
    """Compute samples of each family and write them to an HDF5 file, whole or not at all.

    Datasets, one row per sample: displacement, storage, loss, frequency, poisson, family (a number; names in the
    attribute `families`). Attributes: modality, split, seed, side (m), sha256 of the data, and software versions.
    Blocks of samples are tasks of an executor (`parallel.run`). Finished blocks are stored in a folder beside the
    file until it is written, so that an interrupted run resumes.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    modality : str
        "waves" or "compression".
    families : dict of str to int
        Family → number of samples.
    split : str
        "train", "validation" or "test".
    seed : int, default 0
        Seed of the data set.
    across : int, default 51
        Points along an edge.
    executor : parallel.AnyExecutor, optional
        Where tasks run, see `parallel.run`.
    callback : parallel.Callback, default log_progress
        Called with the progress.

    Raises
    ------
    InputError
        An unknown modality, family or split.
    SolverError
        A field could not be computed.
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
    attributes = {
        "modality": modality,
        "split": split,
        "seed": seed,
        "side": SIDES[modality],
        "families": list(families),
    }
    attributes |= {f"version_{name}": number for name, number in versions().items()}

    def fill(file: h5py.File) -> None:
        for key, values in columns.items():
            file.create_dataset(key, data=values)
        file.attrs.update(attributes | {"sha256": digest(columns)})

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


@dataclass(frozen=True, eq=False, repr=False)
class DataSet(BriefText):
    """A data set written by `generate`, in memory; arrays have one row per sample.

    Parameters
    ----------
    modality : str
        "waves" or "compression".
    split : str
        "train", "validation" or "test".
    side : float
        Edge of the squares (m).
    sha256 : str
        SHA-256 of the data.
    names : tuple of str
        Names of the families.
    displacement : numpy.ndarray
        Displacement (m).
    storage : numpy.ndarray
        Storage modulus, or Young's modulus of compression (Pa).
    loss : numpy.ndarray
        Loss modulus (Pa).
    frequency : numpy.ndarray
        Frequency (Hz).
    poisson : numpy.ndarray
        Poisson's ratio.
    family : numpy.ndarray
        Number of the family.
    """

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
        """Read a file; raises `InputError` where `generate` did not write it or its data have changed."""
        with file_context(path):
            try:
                with hdf5(path, "file") as file:
                    columns: dict[str, Any] = {key: file[key][:] for key in COLUMNS}
                    attributes = {key: file.attrs[key] for key in ("modality", "split", "side", "sha256", "families")}
            except (KeyError, TypeError, ValueError) as error:
                raise InputError(
                    "file", f"without {error}", "data that `ngbrain.surrogate.data.dataset` has written"
                ) from error
            if digest(columns) != attributes["sha256"]:
                raise InputError("sha256", "not that of the data", "a file that nobody has changed")
        return DataSet(names=tuple(attributes.pop("families")), **attributes, **columns)


COLUMNS = ("displacement", "storage", "loss", "frequency", "poisson", "family")


def digest(columns: Mapping[str, Array]) -> str:
    """SHA-256 of arrays by name, in the order of `COLUMNS`."""
    total = hashlib.sha256()
    for key in COLUMNS:
        total.update(np.ascontiguousarray(columns[key]).tobytes())
    return total.hexdigest()


@cache
def _square(side: float, across: int) -> tuple[ngs.Mesh, Array]:
    """The mesh, and points in it, rows along y."""
    lines = np.linspace(0, side, CELLS + 1)
    mesh = rectangles(lines, lines)
    y, x = np.meshgrid(*2 * (np.linspace(0, side, across),), indexing="ij")
    return mesh, mesh(x.ravel(), y.ravel())


def _interpolate(fine: Array, across: int) -> Array:
    """Linear interpolation of an array on `FINE` points to `across` points."""
    places = np.linspace(0, FINE - 1, across)
    return map_coordinates(fine, np.meshgrid(places, places, indexing="ij"), order=1)
