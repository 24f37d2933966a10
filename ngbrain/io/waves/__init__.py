"""Displacement data of elastography: harmonic or quasi-static, at points, with known material properties and, if synthetic, the
truth.

- `data`: Validated displacement data of an experiment.
- `files`: Wave data in files: NumPy archives, HDF5, MATLAB, NIfTI.
- `grid`: Points on a grid, and the boundary of scattered points.
- `labelled`: Wave data and property maps as data sets of xarray.
- `matlab`: MATLAB files.
- `nifti`: Wave data and maps as NIfTI images.
- `samples`: Time samples and MR phases, converted to complex amplitudes.
- `volumes`: Data on the voxels of an image, and other units of length.
"""

from ngbrain.io.waves.data import WaveData
from ngbrain.io.waves.files import read_waves, write_waves
from ngbrain.io.waves.grid import Grid
from ngbrain.io.waves.nifti import write_map

__all__ = ["Grid", "WaveData", "read_waves", "write_map", "write_waves"]
