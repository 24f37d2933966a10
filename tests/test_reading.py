"""Files are data: sizes are asked first, nothing waits for ever, nothing leads elsewhere, nothing is run."""

import gzip
import io
import os
import pickle
import resource
import subprocess
import sys
import zipfile

import h5py
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.image.read.image_file import read_scan
from ngbrain.io.waves import read_waves
from ngbrain.reading import gunzip, read_bytes, read_json, read_npz, read_text
from ngbrain.reading.hdf5 import hdf5


class Runs:
    """Leaves a file where a pickle of it is loaded."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


def peak_kib(code, *args):
    """Most memory (KiB) that Python takes to do something, above what it takes for imports."""
    begin = "import resource, sys; import ngbrain.io.waves, ngbrain.image.read.image_file; "
    start = "a = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss; "
    end = "\nprint(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - a)"
    command = [sys.executable, "-c", begin + start + "\n" + code + end, *map(str, args)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return int(done.stdout.split()[-1])


def refused(code):
    return f"from ngbrain.errors import InputError\ntry:\n    {code}\nexcept InputError as error:\n    print(error)"


def test_devices_and_pipes_are_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.npz")
    for path in ("/dev/zero", "/dev/null", tmp_path / "pipe.npz"):
        for read in (read_bytes, read_text, read_json, read_npz):
            with pytest.raises(InputError, match="no regular file"):
                read(path, "data")
    os.mkfifo(tmp_path / "pipe.nii.gz")
    os.mkfifo(tmp_path / "pipe.h5")
    for read, name in ((read_scan, "pipe.nii.gz"), (read_waves, "pipe.npz"), (read_waves, "pipe.h5")):
        with pytest.raises(InputError, match="no regular file"):
            read(tmp_path / name)


def test_files_are_bounded_in_size(tmp_path):
    (tmp_path / "long").write_bytes(bytes(101))
    assert len(read_bytes(tmp_path / "long", "data", 101)) == 101
    with pytest.raises(InputError, match="101 bytes; wanted: at most 100 bytes"):
        read_bytes(tmp_path / "long", "data", 100)


def test_what_gzip_has_packed_is_bounded_and_checked():
    packed = gzip.compress(bytes(1000)) + gzip.compress(b"more")
    assert gunzip(packed, "data", "x", 1004) == bytes(1000) + b"more"
    assert gunzip(packed + bytes(64), "data", "x") == bytes(1000) + b"more"  # padded, as tapes are
    for bad, said in (
        (packed[:-9], "ends early"),
        (packed[:-5] + b"\1" + packed[-4:], "unreadable"),
        (packed + b"!", "something else"),
    ):
        with pytest.raises(InputError, match=said):
            gunzip(bad, "data", "x")
    with pytest.raises(InputError, match="at most 1,003 bytes"):
        gunzip(packed, "data", "x", 1003)


def test_a_bomb_takes_little_memory(tmp_path):
    with gzip.open(tmp_path / "bomb.nii.gz", "wb", compresslevel=1) as file:
        for _ in range(96):
            file.write(bytes(2**24))  # 1.5 GiB
    code = refused("ngbrain.image.read.image_file.read_scan(sys.argv[1])")
    assert peak_kib(code, tmp_path / "bomb.nii.gz") < 2**18


def test_an_archive_is_asked_for_its_size_first(tmp_path):
    path = tmp_path / "bomb.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("extra.npy", "w", force_zip64=True) as member,
    ):
        np.lib.format.write_array_header_1_0(member, {"descr": "|u1", "fortran_order": False, "shape": (2**31,)})
        for _ in range(128):
            member.write(bytes(2**24))
    assert path.stat().st_size < 2**24
    assert peak_kib(refused("ngbrain.io.waves.read_waves(sys.argv[1])"), path) < 2**17
    with pytest.raises(InputError, match="unpacks to"):
        read_waves(path)


def test_an_array_is_no_larger_than_its_bytes(tmp_path):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "lies.npz", "w") as archive:
        archive.writestr("points.npy", header.getvalue() + bytes(80))
    with pytest.raises(InputError, match="damaged: points has"):
        read_npz(tmp_path / "lies.npz", "data")


def test_nothing_is_unpickled(tmp_path):
    np.savez(tmp_path / "objects.npz", points=np.array([Runs(tmp_path / "ran")], object))
    (tmp_path / "plain.npz").write_bytes(pickle.dumps(Runs(tmp_path / "ran")))
    with zipfile.ZipFile(tmp_path / "member.npz", "w") as archive:
        archive.writestr("points.npy", pickle.dumps(Runs(tmp_path / "ran")))
    for name in ("objects", "plain", "member"):
        with pytest.raises(InputError):
            read_npz(tmp_path / f"{name}.npz", "data")
    assert not (tmp_path / "ran").exists()


def test_hdf5_keeps_to_itself(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["secret"] = np.arange(3.0)
    (tmp_path / "raw").write_bytes(bytes(24))

    def external(file):
        file["points"] = h5py.ExternalLink("other.h5", "secret")

    def below(file):
        file.create_group("a/b")["points"] = h5py.ExternalLink("other.h5", "secret")

    def storage(file):
        file.create_dataset("points", (3,), float, external=[(str(tmp_path / "raw"), 0, 24)])

    def virtual(file):
        layout = h5py.VirtualLayout((3,), float)
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "secret", (3,))
        file.create_virtual_dataset("points", layout)

    for make in (external, below, storage, virtual):
        with h5py.File(tmp_path / "case.h5", "w") as file:
            make(file)
        with pytest.raises(InputError, match="in another file"), hdf5(tmp_path / "case.h5", "data"):
            pass
        with pytest.raises(InputError, match="in another file"):
            read_waves(tmp_path / "case.h5")


def test_hdf5_is_asked_for_its_size_first(tmp_path):
    with h5py.File(tmp_path / "vast.h5", "w") as file:
        file.create_dataset("points", (2 * 10**8, 3), float, chunks=(10**4, 3))  # never written, so nearly no bytes
    assert (tmp_path / "vast.h5").stat().st_size < 2**16
    assert peak_kib(refused("ngbrain.io.waves.read_waves(sys.argv[1])"), tmp_path / "vast.h5") < 2**17
    with pytest.raises(InputError, match="unpacks to 4,800,000,000 bytes; wanted: at most"):
        read_waves(tmp_path / "vast.h5")


def test_groups_that_hold_each_other_end(tmp_path):
    with h5py.File(tmp_path / "ring.h5", "w") as file:
        file.create_group("a")["b"] = file
        file["soft"] = h5py.SoftLink("/soft")
        file["x"] = np.arange(3.0)
    with hdf5(tmp_path / "ring.h5", "data") as file:
        assert file["x"][2] == 2


def test_a_file_is_tried_again_only_when_it_changed(tmp_path, monkeypatch):
    tried, run = [], subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: tried.append(a) or run(*a, **k))
    path = tmp_path / "case.h5"
    for values in (np.zeros(3), np.ones(3)):
        with h5py.File(path, "w") as file:
            file["x"] = values
        for _ in range(2):
            with hdf5(path, "data") as file:
                assert np.array_equal(file["x"][:], values)
    assert len(tried) == 2


@pytest.mark.slow
def test_damaged_hdf5_neither_crashes_nor_spins(tmp_path, rng):
    path = tmp_path / "case.h5"
    with h5py.File(path, "w") as file:
        for name in ("points", "displacement", "mask"):
            file.create_dataset(name, data=rng.normal(size=(40, 3)), chunks=(8, 3), compression="gzip")
    good = path.read_bytes()
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    for _ in range(60):
        damaged = bytearray(good)
        for at in rng.integers(0, len(good), 4):
            damaged[at] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            with hdf5(path, "data") as file:
                file.visititems(lambda _, item: item[()] is None if isinstance(item, h5py.Dataset) else None)
        except (InputError, OSError, KeyError, ValueError, RuntimeError):
            pass
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before < 60 * 20


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        (b"a;b", "a;b"),
        ("ä".encode(), "ä"),
        (b"\xef\xbb\xbfx", "x"),
        ("ä".encode("utf-16"), "ä"),
        ("ä".encode("utf-16-le"), None),
        ("x\nä".encode("latin-1"), None),
    ],
)
def test_text_is_utf_8_or_says_what_it_is(tmp_path, raw, text):
    (tmp_path / "table.csv").write_bytes(raw)
    if text is not None:
        assert read_text(tmp_path / "table.csv", "table") == text
    else:
        with pytest.raises(InputError, match="not UTF-8 in line"):
            read_text(tmp_path / "table.csv", "table")


@pytest.mark.parametrize("raw", [b"", b"{", b"[" * 10**5, b"\xff", b"nul"])
def test_json_that_is_none_is_refused(tmp_path, raw):
    (tmp_path / "card.json").write_bytes(raw)
    with pytest.raises(InputError, match="card is"):
        read_json(tmp_path / "card.json", "card")
