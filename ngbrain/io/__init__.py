"""Files of other programs, checkpoints, and the cache of intermediate results.

- `abaqus`: Nodes, tetrahedra, triangles and element sets of Abaqus input files.
- `cache`: Disk cache of intermediate results.
- `checkpoint`: Checkpoints: one VTKHDF file that ParaView shows and a run restarts from.
- `exchange`: Write tetrahedral meshes for other programs.
- `finished`: Store of finished task results.
- `foreign`: Read tetrahedral meshes of other programs.
- `hdf5`: HDF5 files as bytes.
- `json_file`: JSON files, written atomically.
- `mesh_arrays`: A tetrahedral mesh as plain arrays.
- `nodes`: The quadratic (10-node) view of a tetrahedral mesh.
- `state`: The state of a run as JSON and arrays.
- `surfacefile`: Triangle surfaces: STL, PLY, OBJ, OFF, GIfTI and FreeSurfer.
- `versions`: Versions of all packages that affect results.
- `waves`: Displacement data of elastography.
"""

from ngbrain.io.checkpoint import Checkpoint, Frame, load, save
from ngbrain.io.finished import FinishedWork
from ngbrain.io.json_file import write_json
from ngbrain.io.nodes import QuadraticGrid
from ngbrain.io.versions import show_versions, versions

__all__ = [
    "Checkpoint",
    "FinishedWork",
    "Frame",
    "QuadraticGrid",
    "load",
    "save",
    "show_versions",
    "versions",
    "write_json",
]
