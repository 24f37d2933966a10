"""HDF5 files as bytes."""

from __future__ import annotations

from collections.abc import Callable

import h5py


def hdf5_image(fill: Callable[[h5py.File], object]) -> bytes:
    """Bytes of an HDF5 file that `fill` writes. libhdf5 must not write to disk itself: it crashes on a full disk."""
    with h5py.File("image", "w", driver="core", backing_store=False) as file:
        fill(file)
        file.flush()
        return bytes(file.id.get_file_image())
