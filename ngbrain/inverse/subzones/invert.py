"""Subzone inversion of wave data in space: overlapping boxes, inverted in parallel, then again with consensus.

A zone is a complete inverse problem, because its boundary displacements are unknowns with the noise of the measurement.
`invert_in_space` inverts each zone by itself, in the elements that an inversion of the whole body has there. The logarithms
of moduli and the waves are joined with weights that fall to zero at cut faces.

A consensus pass then inverts each zone again from the joined maps (`consensus`) and joins the results. All zones share one
regularisation weight. The joined waves drive the margins, and the joined map is their prior. The shared weight maximises the
evidence of all zones together (`merge`). So a zone with few details, or with all of them, does not choose its own weight.

The memory is that of one zone, times the number of zones in progress.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import ngsolve as ngs
import numpy as np

from ngbrain import parallel
from ngbrain.adjoint.reduced import Regulariser
from ngbrain.errors import ConvergenceError, InputError, NgbrainError, SolverError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.inverse.data.direct_inversion import uniform_shear
from ngbrain.inverse.data.plausibility import check_frequency
from ngbrain.inverse.data.quality import noise_level, total_noise
from ngbrain.inverse.data.subset import WaveSubset
from ngbrain.inverse.data.time_convention import check_passive
from ngbrain.inverse.elastography.invert_3d import LEAST, MAX_ITERATIONS, invert_in_space, memory_in_space
from ngbrain.inverse.elastography.result import Inversion
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.objective.regularisers import extent
from ngbrain.inverse.optimise.result import Iteration
from ngbrain.inverse.problem.discretisation import element_form
from ngbrain.inverse.problem.property_fields import discretise_lattice
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice, build_lattice
from ngbrain.inverse.subzones.consensus import Neighbourhood, invert_with_consensus
from ngbrain.inverse.subzones.merge import MergedZones, merge_inversion
from ngbrain.inverse.subzones.partition import FEWEST, cut_zones, zone_data
from ngbrain.inverse.subzones.roughness import Roughness
from ngbrain.inverse.subzones.zone_result import ZoneResult, problem_digest
from ngbrain.io.waves import WaveData
from ngbrain.progress import log_progress, reporting

Array = np.ndarray
SIDE, OVERLAP = 1.7, 0.6
"""Lengths of a zone and of an overlap, in shear wavelengths at the highest frequency."""
FEW = 2
"""Fewest elements along a side of a zone beside an overlap, where voxels are too large for more in `SIDE`."""
LESS = 0.05
"""Share of an element by which a size may be too short for whole elements."""


@reporting()
def invert_by_subzones(
    data: WaveData,
    *,
    noise: float | None = None,
    size: float | None = None,
    overlap: float | None = None,
    executor: parallel.AnyExecutor = None,
    labelled: bool = False,
    passes: int = 1,
    max_iterations: int = MAX_ITERATIONS,
    checkpoint: str | os.PathLike[str] | None = None,
    callback: Callable[[Iteration], None] = log_progress,
) -> Inversion:
    """Invert wave data in space zone by zone.

    Parameters
    ----------
    data : WaveData
        Data in space.
    noise : float, optional
        Relative to the rms of each component over all data; by default the noise of the data, or the residual of a smooth fit.
    size : float, optional
        Longest side of a zone with its overlaps, m; by default `SIDE` wavelengths. Zones consist of whole elements.
    overlap : float, optional
        Depth of overlaps, m, about a third of a wavelength for each element; by default `OVERLAP` wavelengths, less where
        `size` is small.
    executor : int or executor, optional
        Inverts the zones, one a task (`parallel.run`). By default this process; a number is a number of processes. The result
        does not depend on it. Workers on other machines need access to the folder of `checkpoint`.
    labelled : bool
        Whether each label has fields of its own.
    passes : int
        Consensus passes. With 0, zones are independent.
    max_iterations : int
        Most iterations of a zone in each pass.
    checkpoint : path, optional
        Folder for a file of each zone and pass; it is created if necessary. A stopped inversion goes on from it.
    callback : callable
        Is called with each `Iteration` of a zone; its phase names the zone.

    Returns
    -------
    Inversion
        Joined maps. Among its `checks`: `disagreement_NAME_first` and `disagreement_NAME`, the rms difference of two zones'
        ln of a modulus where they overlap, before and after the passes; `misfit_over_expected` of the joined waves; and,
        unless the body is too large (`global_check`), `misfit_as_one_body` of the joined maps in one wave problem.

    Raises
    ------
    InputError
        The data are plane, the noise is negative, no zone can have the size, labels are missing, or the checkpoint is of
        another problem.
    SolverError
        A zone fails or its process dies. The message names the zone.

    References
    ----------
    Van Houten et al. 1999, 10.1002/(SICI)1522-2594(199910)42:4<779::AID-MRM21>3.0.CO;2-Z (overlapping subzones); MacKay 1992,
    10.1162/neco.1992.4.3.415 (evidence of a weight).

    Examples
    --------
    >>> line, short = np.arange(16) * 3e-3, np.arange(8) * 3e-3
    >>> grid = np.array([[x, y, z] for z in short for y in short for x in line])
    >>> k = 2 * np.pi * 80 * np.sqrt(1000 / (4000 + 1200j))
    >>> u = 1e-5 * np.stack([np.exp(-1j * k * grid[:, i]) for i in (1, 2, 0)], axis=1)[None]
    >>> data = WaveData(grid, u, [80.0], 1000.0, "isotropic", "viscoelastic", bulk=2e5).with_noise(0.02, seed=0)
    >>> found = invert_by_subzones(data, size=0.027, overlap=0.009, passes=0, max_iterations=1)
    >>> bool(abs(np.median(found.maps["storage"]) / 4000 - 1) < 0.03), found.model["zones"]
    (True, 2)
    """
    _check_lengths(data, size, overlap)
    for name, value, least in (("passes", passes, 0), ("max_iterations", max_iterations, 1)):
        if value < least:
            raise InputError(name, value, f"at least {least}")
    if noise is not None and not 0 <= noise < np.inf:
        raise InputError("noise", noise, "a relative level of at least 0")
    if labelled and data.labels is None:
        raise InputError("labels", "not given", "a whole number for each point, or one field for all")
    check_frequency(data, uniform_shear(data))
    check_passive(data)
    level, note = noise_level(data, noise)
    cells = build_lattice(data, element_form(data))
    zones = cut_zones(data, cells, *_sizes_in_cells(data, cells, size, overlap))
    if not zones:
        raise InputError("mask", "of small pieces alone", f"one of more than {FEWEST} points that touch")
    sure = total_noise(level, LEAST)
    common = ZoneSettings(
        float(np.max(np.ptp(data.points[data.mask], axis=0))), labelled, max_iterations, _folder(checkpoint)
    )
    parts = [(*zone_data(data, zone, sure), zone.cells) for zone in zones]
    names = [f"zone {i + 1} of {len(zones)}" for i in range(len(zones))]
    hear = _forward_iterations(callback)
    tasks: list[parallel.Task] = [
        parallel.Task(name, _invert_independent, (name, own, box, common), memory=_memory(data, box))
        for name, (own, _, box) in zip(names, parts, strict=True)
    ]
    rough = [Roughness(zone.cells, data.points[zone.points]) for zone in zones]
    found = [MergedZones(data, zones, rough, list(parallel.run(tasks, executor, callback=hear).values()))]
    for i in range(passes if len(zones) > 1 else 0):
        last = found[-1]
        tasks = []
        for name, zone, result, (own, chosen, box) in zip(names, zones, last.results, parts, strict=True):
            around = _neighbourhood(last, zone.points, zone.share, own, chosen)
            args = (f"{name}, pass {i + 1}", own, box, around, result, common)
            tasks.append(parallel.Task(name, _invert_with_neighbours, args, memory=_memory(data, box)))
        found.append(
            MergedZones(data, zones, rough, list(parallel.run(tasks, executor, callback=hear).values()), found[0])
        )
    return merge_inversion(found, cells, noise=sure, floor=LEAST, labelled=labelled, notes=[note] if note else [])


def _memory(data: WaveData, cells: VoxelLattice) -> float:
    """Memory (bytes) of a zone."""
    return memory_in_space(cells.form, int(cells.cells.sum()), data.frequency)


@dataclass(frozen=True)
class ZoneSettings:
    """Settings that all zones share.

    Parameters
    ----------
    length : float
        Length of the body, m.
    labelled : bool
        Whether each label has fields of its own.
    max_iterations : int
        Most iterations of a zone.
    folder : Path or None
        Folder of checkpoints.
    """

    length: float
    labelled: bool
    max_iterations: int
    folder: Path | None

    def prior(self, space: ngs.FESpace, reference: Array) -> Regulariser:
        """Build a smooth regulariser, scaled with the body's length so that weights mean the same in all zones.

        Parameters
        ----------
        space : ngsolve.FESpace
            Space of a field.
        reference : numpy.ndarray
            (ndof,) values without penalty.

        Returns
        -------
        Regulariser
            The regulariser.
        """
        return smooth(space, reference, extent(space) / self.length)

    def load_or_invert(self, name: str, problem: str, invert: Callable[[Path | None], ZoneResult]) -> ZoneResult:
        """Return a zone's result, from its file if there is one.

        Parameters
        ----------
        name : str
            Name of the zone and pass.
        problem : str
            Digest that identifies the problem.
        invert : callable
            Inverts the zone; takes the checkpoint of its iterations.

        Returns
        -------
        ZoneResult
            The result.

        Raises
        ------
        InputError
            The file is of another problem. The message names the zone.
        SolverError
            The inversion fails. The message names the zone.
        """
        try:
            if self.folder is None:
                return invert(None)
            stem = name.replace(" ", "-").replace(",", "")
            whole, going = self.folder / f"{stem}.npz", self.folder / f"{stem}.part.npz"
            if whole.exists():
                return ZoneResult.load(whole, problem)
            result = invert(going)
            result.save(whole, problem)
            going.unlink(missing_ok=True)
            return result
        except InputError as error:
            raise InputError(f"{name}: {error.field}", error.value, error.wanted) from error
        except Exception as error:
            said = str(error) if isinstance(error, NgbrainError) else f"{type(error).__name__}: {error}"
            raise SolverError(f"{name}: {said}") from error


def _invert_independent(
    name: str, data: WaveSubset, cells: VoxelLattice, common: ZoneSettings, *, callback: parallel.Callback
) -> ZoneResult:
    def invert(checkpoint: Path | None) -> ZoneResult:
        found = invert_in_space(
            data,
            discretise_lattice(data, cells, common.labelled),
            regulariser=common.prior,
            labelled=common.labelled,
            max_iterations=common.max_iterations,
            checkpoint=checkpoint,
            drop_outliers=False,  # gross errors are judged by all data
            callback=_with_zone_name(name, callback),
        )
        return ZoneResult.from_inversion(found)

    return common.load_or_invert(name, problem_digest(data, cells, replace(common, folder=None)), invert)


def _invert_with_neighbours(
    name: str,
    data: WaveSubset,
    cells: VoxelLattice,
    around: Neighbourhood,
    before: ZoneResult,
    common: ZoneSettings,
    *,
    callback: parallel.Callback,
) -> ZoneResult:
    def invert(checkpoint: Path | None) -> ZoneResult:
        solves = Solves()
        try:
            found = invert_with_consensus(
                data,
                discretise_lattice(data, cells, common.labelled),
                around,
                common.prior,
                floor=LEAST,
                labelled=common.labelled,
                max_iterations=common.max_iterations,
                solves=solves,
                checkpoint=checkpoint,
                callback=_with_zone_name(name, callback),
            )
        except ConvergenceError:  # no step lowers J: the result stays
            return replace(before, solves=solves)
        return ZoneResult.from_inversion(found)

    return common.load_or_invert(name, problem_digest(data, cells, replace(common, folder=None), around.digest), invert)


def _neighbourhood(last: MergedZones, points: Array, share: Array, own: WaveSubset, chosen: Array) -> Neighbourhood:
    """Prior information for a zone from the last pass; `points` are the zone's, `chosen` those of its data."""
    foreign = np.zeros(len(last.data.points))
    foreign[points] = 1 - share
    waves = last.waves[:, chosen]
    usable = own.mask[:, None] & ~np.isnan(waves)
    return Neighbourhood(
        {name: np.where(own.mask, values[chosen], np.nan) for name, values in last.logarithms.items()},
        np.where(usable, waves, own.displacement),
        last.deviation,
        foreign[chosen],
        last.weights,
        last.strength,
    )


def _with_zone_name(name: str, callback: parallel.Callback) -> Callable[[Iteration], None]:
    return lambda iteration: callback(replace(iteration, phase=name))


def _forward_iterations(callback: Callable[[Iteration], None]) -> parallel.Callback:
    return lambda iteration: callback(iteration)


def _check_lengths(data: WaveData, size: float | None, overlap: float | None) -> None:
    if data.dim != 3:
        raise InputError("points", "in the plane", "points in space; `invert` takes those in the plane")
    for name, value in (("size", size), ("overlap", overlap)):
        if value is not None and not 0 <= value < np.inf:
            raise InputError(name, value, "a length in m")
    if (size is None or overlap is None) and not data.frequency.any():
        raise InputError("size or overlap", "not given", "lengths in m: quasi-static data have no wavelength")


def _sizes_in_cells(
    data: WaveData, cells: VoxelLattice, size: float | None, overlap: float | None
) -> tuple[Array, Array]:
    """Size and overlap (dim,) in whole cells.

    A given size is not exceeded. Other lengths are rounded, an overlap to one cell at least.

    Raises `InputError` where less than a cell is left beside the overlap, or too few points.
    """
    side = np.array([np.diff(plane).max() for plane in cells.planes])
    wave = np.inf
    if size is None or overlap is None:
        wave = np.sqrt(uniform_shear(data) / data.density) / float(data.frequency.max())
    if overlap is None:
        overlap = OVERLAP * wave if size is None else min(OVERLAP * wave, OVERLAP / SIDE * size)
    shared = np.maximum(np.rint(overlap / side), overlap > 0).astype(int)
    if size is None:
        return np.maximum(np.rint(SIDE * wave / side).astype(int), shared + FEW), shared
    most = (size / side + LESS).astype(int)
    least = max(float(np.max((shared + 1) * side)), overlap + FEWEST ** (1 / 3) * data.point_spacing)
    if size < least * (1 - 1e-9) or not np.all(most > shared):
        wanted = f"{least:.3g} m or more, {float(np.max(shared * side)):.3g} of it an overlap"
        raise InputError("size", f"{size:.3g}", wanted)
    return most, shared


def _folder(checkpoint: str | os.PathLike[str] | None) -> Path | None:
    if checkpoint is None:
        return None
    folder = Path(checkpoint).absolute()  # other processes may have another working directory
    if folder.exists() and not folder.is_dir():
        raise InputError("checkpoint", str(folder), "a folder, or a name that is free")
    folder.mkdir(parents=True, exist_ok=True)
    return folder
