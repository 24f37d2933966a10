"""Files that are nearly right: bytes, lines, numbers and keys of real ones changed by a seeded generator."""

import re
import shutil

import h5py
import numpy as np

from ngbrain.datasets import SHIPPED
from ngbrain.image.read.nifti import write_nifti
from ngbrain.image.read.volume import Volume
from ngbrain.io import Frame, QuadraticGrid, save
from ngbrain.io.waves import read_waves, write_waves
from ngbrain.mesh import block
from ngbrain.surrogate.prediction.pretrained import WEIGHTS

ODD = (
    "",
    "nan",
    "inf",
    "-1",
    "0",
    "1e300",
    "1e-300",
    "1e999",
    "3_5",
    "0,5",
    "true",
    '"text"',
    "[]",
    "{}",
    "null",
    "9" * 400,
    "\x00",
)
ARRAYS = (
    lambda a: a[:-1] if a.ndim else np.array([a]),
    lambda a: a * np.nan if a.dtype.kind in "fc" else a.astype(float if a.dtype.kind in "biuf" else "U8"),
    lambda a: a.astype("S8") if a.dtype.kind in "fiu" else np.array("?"),
    lambda a: np.zeros((0, *a.shape[1:]), a.dtype) if a.ndim else np.array(-1.0),
    lambda a: a.reshape(-1),
    lambda a: a[None],
    lambda a: a * 1e300 if a.dtype.kind in "fc" else a,
    lambda a: a.astype(complex) if a.dtype.kind in "fiu" else a,
    lambda a: np.array(["x"]),
    lambda a: a.T,
)


def bytes_changed(raw, random):
    """Some bytes flipped, a part left out, repeated or zero."""
    raw = bytearray(raw)
    kind = random.integers(6)
    at = int(random.integers(max(len(raw), 1)))
    size = int(random.integers(1, 64))
    if kind == 0:
        return bytes(raw[:at])
    if kind == 1:
        return bytes(raw[:at] + raw[at + size :])
    if kind == 2:
        return bytes(raw[:at] + raw[at : at + size] + raw[at:])
    if kind == 3:
        raw[at : at + size] = bytes(len(raw[at : at + size]))
        return bytes(raw)
    for place in random.integers(0, max(len(raw), 1), 1 + 7 * (kind == 4)):
        raw[place] = random.integers(256)
    return bytes(raw)


def text_changed(raw, random):
    """A number, a word or a line of a text put in place of another, doubled or left out; sometimes another encoding."""
    text = raw.decode()
    kind = random.integers(7)
    lines = text.split("\n")
    at = int(random.integers(len(lines)))
    if kind < 3:
        found = list(re.finditer(r"-?\d[\d.e+-]*|\"[^\"]*\"|true|false", text))
        if found:
            one = found[int(random.integers(len(found)))]
            text = text[: one.start()] + str(random.choice(np.array(ODD, object))) + text[one.end() :]
    elif kind == 3:
        text = "\n".join(lines[:at] + lines[at + 1 :])
    elif kind == 4:
        text = "\n".join([*lines[:at], lines[at], *lines[at:]])
    elif kind == 5:
        return text.encode(str(random.choice(["utf-16", "utf-8-sig", "utf-32", "cp500"])))
    else:
        other = int(random.integers(len(lines)))
        lines[at], lines[other] = lines[other], lines[at]
        text = "\n".join(lines)
    return text.encode()


def arrays_changed(arrays, random):
    """One array of a file of another shape, type or size, under another name, or gone."""
    arrays = dict(arrays)
    name = str(random.choice(sorted(arrays)))
    kind = int(random.integers(len(ARRAYS) + 2))
    if kind == len(ARRAYS):
        del arrays[name]
    elif kind > len(ARRAYS):
        arrays[name[:-1] + "_"] = arrays.pop(name)
    else:
        with np.errstate(all="ignore"):
            arrays[name] = ARRAYS[kind](np.asarray(arrays[name]))
    return arrays


def made(folder):
    """One small file of each kind, by name."""
    folder.mkdir(parents=True, exist_ok=True)
    waves = read_waves(SHIPPED / "waves_plane.npz")
    write_waves(folder / "waves.npz", waves)
    write_waves(folder / "waves.h5", waves)
    write_waves(folder / "waves.nii", waves)
    for name in ("plate.toml", "retraction.toml", "retraction_force.csv", "retraction_landmarks.csv"):
        shutil.copy(SHIPPED / name, folder)
    shutil.copy(WEIGHTS / "waves.json", folder / "card.json")
    grid = QuadraticGrid(block((0.1, 0.1, 0.1), 0.1))
    save(folder / "run.vtkhdf", grid, [Frame(0.0, {"p": grid.points[:, 0]})], {"step": 1, "u": np.arange(9.0)})
    head = np.zeros((60, 60, 60), np.float32)
    head[15:45, 15:45, 15:45] = np.random.default_rng(0).normal(100, 20, (30, 30, 30))
    write_nifti(folder / "scan.nii.gz", Volume(head, np.diag([2e-3, 2e-3, 2e-3, 1])))
    return {path.name: path for path in sorted(folder.iterdir())}


def changed(path, place, random):
    """A changed copy of a file at a place, with what belongs to it beside it."""
    for other in path.parent.glob(f"{path.name.partition('.')[0]}*"):
        shutil.copy(other, place / other.name)
    target = place / path.name
    structured = random.integers(2)
    if path.suffix in (".toml", ".csv", ".json"):
        target.write_bytes(text_changed(path.read_bytes(), random))
    elif path.suffix == ".npz" and structured:
        with np.load(path) as file:
            np.savez(target, **arrays_changed(file, random))
    elif path.suffix == ".h5" and structured:
        with h5py.File(path) as file:
            arrays = arrays_changed({name: item[()] for name, item in file.items()}, random)
        with h5py.File(target, "w") as file:
            for name, values in arrays.items():
                file[name] = values.astype("S8") if getattr(values, "dtype", np.dtype("f8")).kind == "U" else values
    elif path.name == "waves.nii" and structured:
        sidecar = target.with_suffix(".json")
        sidecar.write_bytes(text_changed(sidecar.read_bytes(), random))
    else:
        target.write_bytes(bytes_changed(path.read_bytes(), random))
    return target
