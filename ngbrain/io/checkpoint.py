"""Checkpoints: one file that ParaView shows and a run restarts from.

A checkpoint is a VTKHDF 2 file (`.vtkhdf`, an HDF5 file): the mesh once, the frames as time steps. Next to the group `/VTKHDF`,
the group `/ngbrain`, which viewers ignore, holds the exact mesh and the state of the run.

    /VTKHDF            quadratic tetrahedra, PointData per frame, CellData/region, FieldData/region_names, Steps
    /ngbrain           attributes: format, ngsolve (the version that wrote it)
    /ngbrain/mesh      arrays that the mesh is rebuilt from (`ngbrain.io.mesh_arrays`)
    /ngbrain/state     the state as JSON, where ["array", i] stands for /ngbrain/arrays/i
    last 48 bytes      a marker and the SHA-256 of all bytes before it; HDF5 readers ignore bytes after their data
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import ngsolve as ng
import numpy as np
import numpy.typing as npt

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError
from ngbrain.io.hdf5 import hdf5_image
from ngbrain.io.mesh_arrays import build_mesh
from ngbrain.io.nodes import QuadraticGrid
from ngbrain.io.state import pack, read_array, unpack, write_array
from ngbrain.look import BriefText
from ngbrain.reading import check_regular
from ngbrain.reading.hdf5 import hdf5

Array = npt.NDArray[Any]

_FORMAT = 2
_PICKLED = 1
_MARK = b"ngbrain  sha256\n"
_SEAL = len(_MARK) + hashlib.sha256().digest_size
_VTK_QUADRATIC_TETRA = 24
MOST_CHECKPOINT = 2**34
"""Maximum size (bytes) of a checkpoint: 16 GiB."""
ROUNDING = 1e-12
"""Tolerance of the nodes of a rebuilt mesh, relative to the largest coordinate."""
# Types of VTK: no half or extended precision, no complex numbers, no bool.
_VTK_TYPES = {"f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"}


@dataclass(frozen=True, eq=False, repr=False)
class Frame(BriefText):
    """Fields at one time.

    Parameters
    ----------
    time : float
        Time (s), or another quantity that orders the frames.
    point_data : mapping
        Name → (n,) or (n, k) values at the nodes of the grid, as from `QuadraticGrid.values`. The data type is kept; float32 is
        enough for pictures.
    """

    time: float
    point_data: Mapping[str, Array]


@dataclass(frozen=True, eq=False, repr=False)
class Checkpoint(BriefText):
    """Content of a checkpoint, as it was given to `save`.

    Parameters
    ----------
    grid : QuadraticGrid
        The grid, with its mesh.
    frames : tuple of Frame
        Fields over time.
    state : dict
        State of the run.
    cell_data : dict
        Name → (ntets,) or (ntets, k) values.
    """

    grid: QuadraticGrid
    frames: tuple[Frame, ...]
    state: dict[str, Any]
    cell_data: dict[str, Array]

    @property
    def mesh(self) -> ng.Mesh:
        """The mesh of the run: same points to the last bit, same numbering, same curvature."""
        return self.grid.mesh


def save(
    path: str | os.PathLike[str],
    grid: QuadraticGrid,
    frames: Sequence[Frame] = (),
    state: Mapping[str, Any] | None = None,
    cell_data: Mapping[str, Array] | None = None,
) -> None:
    """Write a checkpoint atomically: the file at `path` is always the complete old or the complete new one.

    It is written to a temporary file, flushed to disk and renamed (`ngbrain.atomic`). If the process is killed meanwhile, the
    old file stays, and the next `save` removes the temporary one.

    Parameters
    ----------
    path : str or Path
        Output file in an existing folder; ParaView recognises the suffix `.vtkhdf`.
    grid : QuadraticGrid
        The mesh.
    frames : sequence of Frame, optional
        In order of time, all with the same fields.
    state : mapping, optional
        Name → None, bool, int, float, str, NumPy numbers, NumPy arrays without objects, and lists, tuples and mappings of
        these.
    cell_data : mapping, optional
        Name → (ntets,) or (ntets, k), constant in time. "region" is always added.

    Raises
    ------
    InputError
        An argument is not as described. Nothing is written.
    OSError
        The disk is full, the folder is not writable, ...

    Examples
    --------
    >>> import tempfile
    >>> from netgen.occ import unit_cube
    >>> grid = QuadraticGrid(ng.Mesh(unit_cube.GenerateMesh(maxh=1)))
    >>> u = ng.GridFunction(ng.VectorH1(grid.mesh, order=2))
    >>> u.Set(ng.CF((ng.x, 0, 0)))
    >>> frames = [Frame(0.5, {"displacement": grid.values(u)})]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(f"{folder}/run.vtkhdf", grid, frames, {"u": u.vec.FV().NumPy(), "step": 12})
    ...     back = load(f"{folder}/run.vtkhdf")
    >>> v = ng.GridFunction(ng.VectorH1(back.mesh, order=2))
    >>> v.vec.FV().NumPy()[:] = back.state["u"]
    >>> back.state["step"], back.frames[0].time
    (12, 0.5)
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError("checkpoint", path, "a file in a folder that exists")
    arrays: list[tuple[str, Array]] = []
    packed = pack(dict(state or {}), "state", arrays)
    if "region" in (cell_data or {}):
        raise InputError("cell_data", "'region'", "another name, this one is taken")
    cells: dict[str, Array] = {"region": grid.region, **(cell_data or {})}
    _check(frames, cells, grid)

    def fill(file: h5py.File) -> None:
        _write_vtk(file.create_group("VTKHDF"), grid, frames, cells)
        own = file.create_group("ngbrain")
        own.attrs.update({"format": _FORMAT, "ngsolve": ng.__version__})
        for name, array in grid.arrays.items():
            own[f"mesh/{name}"] = array
        own["state"] = np.frombuffer(json.dumps(packed).encode(), np.uint8)
        for i, (name, array) in enumerate(arrays):
            write_array(own, f"arrays/{i}", array).attrs["name"] = name

    image = hdf5_image(fill)
    seal = _MARK + _digest(io.BytesIO(image), len(image))

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            stream.write(image)
            stream.write(seal)

    atomic_write(path, write)


def load(path: str | os.PathLike[str]) -> Checkpoint:
    """Read a checkpoint: arrays, floats and mesh points are equal to the last bit. Nothing in the file is executed.

    Raises
    ------
    InputError
        The file does not exist; it is truncated, damaged, edited or not written by `save`; it was written by an earlier ngbrain
        that pickled the mesh, or by a version of ngsolve that numbers meshes differently.
    """
    path = Path(path)
    _verify(path)
    try:
        return _read(path)
    except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:  # valid checksum, but not by `save`
        if isinstance(error, InputError):
            if error.field == "checkpoint":
                raise
            raise InputError("checkpoint", path, f"an undamaged one; its {error.field} is {error.value}") from error
        raise InputError("checkpoint", path, f"what ngbrain wrote ({type(error).__name__}: {error})") from error


def _read(path: Path) -> Checkpoint:
    with hdf5(path, "checkpoint", MOST_CHECKPOINT, whole=True) as file:
        own, vtk = file["ngbrain"], file["VTKHDF"]
        if own.attrs["format"] == _PICKLED:
            wanted = "one of this version: it was written when meshes were kept as pickles, which can run any code; run it anew"
            raise InputError("checkpoint", path, wanted)
        if own.attrs["format"] != _FORMAT:
            raise InputError("checkpoint", path, f"format {_FORMAT}, not {own.attrs['format']}: update ngbrain")
        grid = _read_grid(path, own, vtk)
        arrays = [read_array(own[f"arrays/{i}"]) for i in range(len(own.get("arrays", ())))]
        state = unpack(json.loads(own["state"][()].tobytes()), arrays)
        cells = {name: data[()] for name, data in vtk["CellData"].items() if name != "region"}
        times = vtk["Steps/Values"][()] if "Steps" in vtk else np.zeros(0)
        points = {name: data[()].reshape(len(times), -1, *data.shape[1:]) for name, data in vtk["PointData"].items()}
    frames = tuple(Frame(float(t), {name: data[i] for name, data in points.items()}) for i, t in enumerate(times))
    return Checkpoint(grid, frames, state, cells)


def _digest(stream: BinaryIO, size: int) -> bytes:
    """SHA-256 of the first `size` bytes, in chunks: a checkpoint may be larger than the free memory."""
    sha = hashlib.sha256()
    while size > 0 and (piece := stream.read(min(size, 1 << 20))):
        sha.update(piece)
        size -= len(piece)
    return sha.digest()


def _verify(path: Path) -> None:
    """Verify the checksum before HDF5, which may crash on damaged input, reads a byte."""
    try:
        check_regular(path, "checkpoint", MOST_CHECKPOINT)
        with open(path, "rb") as stream:
            size = os.fstat(stream.fileno()).st_size - _SEAL
            digest = _digest(stream, size)
            seal = stream.read() if size >= 0 else b""
    except OSError as error:
        raise InputError("checkpoint", path, f"a file that can be read ({error.strerror})") from error
    if not seal.startswith(_MARK):
        raise InputError("checkpoint", path, "a whole checkpoint; this is cut short, or ngbrain did not write it")
    if seal != _MARK + digest:
        raise InputError("checkpoint", path, "a checkpoint as it was written; the checksum of this one does not match")


def _read_grid(path: Path, own: h5py.Group, vtk: h5py.Group) -> QuadraticGrid:
    grid = QuadraticGrid(build_mesh({name: data[()] for name, data in own["mesh"].items()}))
    points = vtk["Points"][()]
    same = np.array_equal(vtk["Connectivity"][()], grid.connectivity.ravel()) and points.shape == grid.points.shape
    if not same or not np.allclose(points, grid.points, rtol=0, atol=ROUNDING * np.abs(points).max(initial=0)):
        wrote = f"ngsolve {own.attrs['ngsolve']}, which wrote it (this is {ng.__version__})"
        raise InputError("checkpoint", path, f"{wrote}; edges are numbered otherwise here")
    grid.points = points  # nodes on curved edges are exact too
    return grid


def _check(frames: Sequence[Frame], cells: Mapping[str, Array], grid: QuadraticGrid) -> None:
    times = [frame.time for frame in frames]
    if not all(map(math.isfinite, times)) or any(b <= a for a, b in pairwise(times)):
        raise InputError("frames", f"at times {times}", "finite times, each later than the one before")
    kinds = [_check_fields(f"frames[{i}].point_data", f.point_data, len(grid.points)) for i, f in enumerate(frames)]
    for i, kind in enumerate(kinds):
        if kind != kinds[0]:
            raise InputError(f"frames[{i}].point_data", kind, f"the fields of the first frame, {kinds[0]}")
    _check_fields("cell_data", cells, len(grid.connectivity))


def _check_fields(where: str, fields: Mapping[str, Array], rows: int) -> dict[str, str]:
    """Refuse fields that VTK cannot hold; returns type and shape of every field."""
    for name, data in fields.items():
        data = np.asarray(data)
        if name in ("", ".") or "/" in name:
            raise InputError(where, repr(name), "a name without '/'")
        if data.ndim not in (1, 2) or len(data) != rows or data.dtype.str[1:] not in _VTK_TYPES:
            found = f"{data.dtype} of shape {data.shape}"
            raise InputError(f"{where}[{name!r}]", found, f"real numbers of shape ({rows},) or ({rows}, k)")
    return {name: f"{np.asarray(data).dtype} {np.shape(data)}" for name, data in fields.items()}


def _write_vtk(vtk: h5py.Group, grid: QuadraticGrid, frames: Sequence[Frame], cells: Mapping[str, Array]) -> None:
    """Write the VTKHDF part: one piece, with the geometry shared by all steps (all offsets into it are 0)."""
    ntets, n, steps = len(grid.connectivity), len(grid.points), len(frames)
    vtk.attrs["Version"] = [2, 2]
    vtk.attrs["Type"] = np.bytes_("UnstructuredGrid")  # readers want a string of fixed length
    vtk["NumberOfPoints"], vtk["NumberOfCells"], vtk["NumberOfConnectivityIds"] = [n], [ntets], [10 * ntets]
    vtk["Points"], vtk["Connectivity"] = grid.points, grid.connectivity.ravel()
    vtk["Offsets"] = np.arange(ntets + 1) * 10
    vtk["Types"] = np.full(ntets, _VTK_QUADRATIC_TETRA, np.uint8)
    for name, data in cells.items():
        vtk[f"CellData/{name}"] = data
    # UTF-8 bytes under an ASCII label: VTK 9.7 crashes on text of fixed length or labelled UTF-8.
    names = [name.encode() for name in grid.region_names]
    vtk.create_dataset("FieldData/region_names", data=names, dtype=h5py.string_dtype("ascii"))
    points = vtk.create_group("PointData")
    if not frames:
        return  # a mesh without frames
    series = vtk.create_group("Steps")
    series.attrs["NSteps"] = steps
    series["Values"] = np.array([frame.time for frame in frames], float)
    series["NumberOfParts"] = np.ones(steps, int)
    still = ["PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets", "FieldDataOffsets/region_names"]
    for name in still + [f"CellDataOffsets/{name}" for name in cells]:
        series[name] = np.zeros(steps, int)
    series["FieldDataSizes/region_names"] = np.tile([1, len(grid.region_names)], (steps, 1))
    for name, first in frames[0].point_data.items():
        data = points.create_dataset(name, (steps * n, *np.shape(first)[1:]), np.asarray(first).dtype)
        for i, frame in enumerate(frames):
            data[i * n : (i + 1) * n] = frame.point_data[name]
        series[f"PointDataOffsets/{name}"] = np.arange(steps) * n
