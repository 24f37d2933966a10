"""Wheels for a machine with a GPU but without a package index, in parts that can be copied one after another.

Archives go into the first part with room for them; what is larger than a part is cut into pieces. Of packages that are mostly
unused, only the libraries that are loaded travel, compressed. `unpack` puts into a folder what has arrived so far.
"""

from __future__ import annotations

import configparser
import ctypes
import lzma
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

PYTHON = "3.12"
"""Of the machine with the GPU."""
PART_BYTES = 40 * 2**20
PLATFORMS = [f"manylinux_2_{minor}_x86_64" for minor in (34, 31, 28, 27, 26, 24, 17)] + ["manylinux2014_x86_64"]
FOLLOWED = ("netgen-mesher", "netgen-occt", "ngsolve-openblas")
"""Packages whose version another wheel of the pack fixes."""
EXPECTED = ("numpy", "scipy", "h5py", "matplotlib", "cuda-bindings", "cuda-core", "cuda-pathfinder", "nvidia-cublas")
"""Packages that the machine has: the pack leaves them out."""
PACKAGES = (
    "ngsolve", "netgen-mesher", "netgen-occt", "ngsolve-openblas", "pyamg", "meshio", "nvidia-cuda-runtime-cu12",
    "nvidia-nvjitlink-cu12", "nvidia-cuda-nvrtc-cu12", "nvmath-python", "nvidia-cudss-cu13==0.8.*",
)  # fmt: skip
KEPT = {
    "nvidia-cuda-nvrtc-cu12": r"\.dist-info/|__init__\.py$|/libnvrtc(-builtins)?\.so\.",
    "nvidia-cudss-cu13": r"\.dist-info/|__init__\.py$|/libcudss(_mtlayer_gomp)?\.so\.",
}
"""Files of packages that are mostly unused."""
LIBRARIES = ("libcudart.so.12", "libnvrtc-builtins.so.12*", "libnvrtc.so.12", "libnvJitLink.so.12", "libcudss.so.0")
"""Loaded before NGSolve or nvmath looks for them, in this order."""


def pack(folder: Path, part_bytes: int = PART_BYTES) -> list[Path]:
    """Download what a bare machine lacks and lay it out in parts.

    Parameters
    ----------
    folder : Path
        Gets `wheels/` and `part-1/`, `part-2/`, …; parts that are there are made anew.
    part_bytes : int
        Size of a part, at most.

    Returns
    -------
    list of Path
        The parts in the order in which they are to be copied.
    """
    wheels = folder / "wheels"
    wheels.mkdir(parents=True, exist_ok=True)
    pins = {"ngsolve": version("ngsolve")}
    archives = []
    for package in PACKAGES:
        name, _, wanted = package.partition("==")
        wanted = pins.get(name, wanted)
        wheel = download(f"{name}=={wanted}" if wanted else name, wheels)
        pins |= {other: pin for other, pin in requirements(wheel) if other in FOLLOWED}
        archives.append(reduced(wheel, KEPT[name], wheels) if name in KEPT else wheel)
    return lay_out(archives, folder, part_bytes)


def download(package: str, folder: Path) -> Path:
    """One wheel for the machine with the GPU, by pip."""
    stem = re.split("[=<>]", package)[0].replace("-", "_")
    there = set(folder.glob(f"{stem}-*.whl"))
    options = [part for platform in PLATFORMS for part in ("--platform", platform)]
    subprocess.run(
        [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps",
         "--only-binary=:all:", "--implementation", "cp", "--python-version", PYTHON, *options, "-d", folder, package],
        check=True,
    )  # fmt: skip
    return max(set(folder.glob(f"{stem}-*.whl")) - there or there, key=lambda path: path.stat().st_mtime)


def requirements(wheel: Path) -> Iterator[tuple[str, str]]:
    """Packages of which a wheel wants one version, with it."""
    with zipfile.ZipFile(wheel) as archive:
        metadata = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        text = archive.read(metadata).decode()
    yield from re.findall(r"^Requires-Dist: ([\w.-]+) *\(?==([\w.]+)", text, re.M)


def reduced(wheel: Path, kept: str, folder: Path) -> Path:
    """A compressed archive of those files of a wheel whose name matches a pattern."""
    packed = folder / f"{wheel.name.split('-')[0]}.tar.xz"
    if packed.exists() and packed.stat().st_mtime > wheel.stat().st_mtime:
        return packed
    with zipfile.ZipFile(wheel) as source, tarfile.open(packed, "w:xz", preset=6) as target:
        for entry in source.infolist():
            if re.search(kept, entry.filename) and ".alt.so" not in entry.filename:
                info = tarfile.TarInfo(entry.filename)
                info.size = entry.file_size
                target.addfile(info, source.open(entry))
    return packed


def lay_out(archives: Sequence[Path], folder: Path, part_bytes: int) -> list[Path]:
    """Copy archives, or pieces of them, into as few folders as first fit finds; returns these in order."""
    for part in folder.glob("part-*"):
        shutil.rmtree(part)
    used: list[int] = []
    for archive in archives:
        data = archive.read_bytes()
        pieces = [data[k : k + part_bytes] for k in range(0, len(data), part_bytes)]
        for k, piece in enumerate(pieces):
            number = next((n for n, size in enumerate(used) if size + len(piece) <= part_bytes), len(used))
            if number == len(used):
                used.append(0)
            used[number] += len(piece)
            part = folder / f"part-{number + 1}"
            part.mkdir(exist_ok=True)
            name = archive.name if len(pieces) == 1 else f"{archive.name}.{k + 1}of{len(pieces)}"
            (part / name).write_bytes(piece)
    return [folder / f"part-{number + 1}" for number in range(len(used))]


def unpack(parts: Iterable[Path], site: Path) -> list[str]:
    """Unpack the archives of parts into a folder; pieces wait there until their archive is whole. Returns what was unpacked."""
    site.mkdir(parents=True, exist_ok=True)
    about = configparser.ConfigParser()
    about.read(Path(__file__).parents[1] / "setup.cfg")
    own = (
        site / f"ngbrain-{about['metadata']['version']}.dist-info"
    )  # ngbrain runs from its tree and asks for its own version
    own.mkdir(exist_ok=True)
    (own / "METADATA").write_text(f"Metadata-Version: 2.1\nName: ngbrain\nVersion: {about['metadata']['version']}\n")
    namespace = site / "nvidia" / "__init__.py"  # another one on the machine would hide the libraries that lie here
    namespace.parent.mkdir(exist_ok=True)
    namespace.write_text("__path__ = __import__('pkgutil').extend_path(__path__, __name__)\n")
    done = []
    for archive in sorted(file for part in parts for file in part.iterdir()):
        name, pieces = archive.name, re.fullmatch(r"(.+)\.(\d+)of(\d+)", archive.name)
        if pieces:
            shutil.copy(archive, site / archive.name)
            name, count = pieces[1], int(pieces[3])
            waiting = [site / f"{name}.{k + 1}of{count}" for k in range(count)]
            if not all(piece.exists() for piece in waiting):
                continue
            archive = site / name
            archive.write_bytes(b"".join(piece.read_bytes() for piece in waiting))
        if name.endswith(".whl"):
            with zipfile.ZipFile(archive) as wheel:
                wheel.extractall(site)
        else:
            with lzma.open(archive) as stream, tarfile.open(fileobj=stream) as tar:
                tar.extractall(site, filter="data")
        done.append(name)
    return done


def preload(site: Path) -> dict[str, str]:
    """Load NVIDIA's libraries that lie in a folder, so that those who ask for them by name find them.

    Returns
    -------
    dict
        Library → "" where it was loaded, else why not.
    """
    found = {}
    try:  # cuDSS is linked with it, and the machine has it
        from cuda.pathfinder import load_nvidia_dynamic_lib

        load_nvidia_dynamic_lib("cublas")
    except Exception as error:  # its own kinds of errors, or none there
        found["libcublas"] = f"{type(error).__name__}: {error}"
    for pattern in LIBRARIES:
        paths = sorted(site.glob(f"nvidia/*/lib/{pattern}"))
        try:
            for path in paths:
                ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
            found[pattern] = "" if paths else "not there"
        except OSError as error:
            found[pattern] = str(error)
    return found
