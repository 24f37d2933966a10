"""Files of other programs, checkpoints, and the cache of intermediate results.

- wave data: `WaveData`, `Grid`, `read_waves`, `write_waves`, `write_map` (maps as NIfTI)
- meshes of other programs: `read_mesh`, `write_mesh`, `QuadraticGrid` (the 10-node view)
- triangle surfaces: `read_surface`, `write_surface`
- checkpoints of runs: `Checkpoint`, `Frame`, `load`, `save`
- results: `write_json`, `FinishedWork` (a store of finished tasks), `load_or_compute` (a disk cache)
- versions of all packages that affect results: `versions`, `show_versions`; what is installed: `ngbrain doctor`

Modules
-------
- `abaqus`: Nodes, tetrahedra, triangles and element sets of Abaqus input files.
- `cache`: Disk cache of intermediate results.
- `checkpoint`: Checkpoints: one VTKHDF file that ParaView shows and a run restarts from.
- `exchange`: Write tetrahedral meshes for other programs.
- `finished`: Store of finished task results.
- `foreign`: Read tetrahedral meshes of other programs.
- `hdf5`: HDF5 files as bytes.
- `json_file`: JSON files, written atomically.
- `labelled_arrays`: Arrays with named axes and units, as `to_xarray` returns them.
- `mesh_arrays`: A tetrahedral mesh as plain arrays.
- `nodes`: The quadratic (10-node) view of a tetrahedral mesh.
- `state`: The state of a run as JSON and arrays.
- `surfacefile`: Triangle surfaces: STL, PLY, OBJ, OFF, GIfTI and FreeSurfer.
- `waves`: Displacement data of elastography.
"""

from typing import TYPE_CHECKING

from ngbrain.io.versions import show_versions, versions  # at once: the module has the name of the function
from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.io import (
        abaqus,
        cache,
        checkpoint,
        exchange,
        finished,
        foreign,
        hdf5,
        json_file,
        labelled_arrays,
        mesh_arrays,
        nodes,
        state,
        surfacefile,
        waves,
    )
    from ngbrain.io.cache import load_or_compute
    from ngbrain.io.checkpoint import Checkpoint, Frame, load, save
    from ngbrain.io.exchange import write_mesh
    from ngbrain.io.finished import FinishedWork
    from ngbrain.io.foreign import read_mesh
    from ngbrain.io.json_file import write_json
    from ngbrain.io.nodes import QuadraticGrid
    from ngbrain.io.surfacefile import read_surface, write_surface
    from ngbrain.io.waves.data import WaveData
    from ngbrain.io.waves.files import read_waves, write_waves
    from ngbrain.io.waves.grid import Grid
    from ngbrain.io.waves.nifti import write_map
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "Checkpoint",
    "FinishedWork",
    "Frame",
    "Grid",
    "QuadraticGrid",
    "WaveData",
    "abaqus",
    "cache",
    "checkpoint",
    "exchange",
    "finished",
    "foreign",
    "hdf5",
    "json_file",
    "labelled_arrays",
    "load",
    "load_or_compute",
    "mesh_arrays",
    "nodes",
    "read_mesh",
    "read_surface",
    "read_waves",
    "save",
    "show_versions",
    "state",
    "surfacefile",
    "versions",
    "waves",
    "write_json",
    "write_map",
    "write_mesh",
    "write_surface",
    "write_waves",
]
