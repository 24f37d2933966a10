"""Safe reading of files: sizes are checked before memory is allocated, and nothing in a file is executed.

- `files`: bytes, text, JSON, tables, NumPy archives, zip and gzip: `read_bytes`, `read_text`, `read_json`, `read_table`
  (a `Table`), `read_npz`, `npz_arrays`, `unzip`, `gunzip`; `check_regular`, `check_size` against the limits `MOST`, `MOST_TEXT`.
- `hdf5`: HDF5 files, first read in a subprocess.
"""

from ngbrain.reading.files import (
    MOST,
    MOST_TEXT,
    Table,
    check_regular,
    check_size,
    gunzip,
    npz_arrays,
    read_bytes,
    read_json,
    read_npz,
    read_table,
    read_text,
    unzip,
)

__all__ = [
    "MOST",
    "MOST_TEXT",
    "Table",
    "check_regular",
    "check_size",
    "gunzip",
    "npz_arrays",
    "read_bytes",
    "read_json",
    "read_npz",
    "read_table",
    "read_text",
    "unzip",
]
