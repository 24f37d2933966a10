"""Wave data: harmonic or quasi-static displacements at points, with what is known of the material and, perhaps, the truth."""

from ngbrain.io.waves.data import WaveData
from ngbrain.io.waves.files import read_waves, write_waves
from ngbrain.io.waves.grid import Grid
from ngbrain.io.waves.nifti import write_map

__all__ = ["Grid", "WaveData", "read_waves", "write_map", "write_waves"]
