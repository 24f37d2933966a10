"""Cache: computed once, the same bits again, recomputed when damaged or for other inputs."""

import sys
import types
from pathlib import Path

import numpy as np
import pytest

import ngbrain
from ngbrain.io.cache import _DIGEST, cache_folder, load_or_compute, source_files

PACKAGE = Path(ngbrain.__file__).parent


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NGBRAIN_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module whose source can be written anew."""
    module = types.ModuleType("maker")
    monkeypatch.setitem(sys.modules, "maker", module)
    module.__file__ = str(tmp_path / "maker.py")
    (tmp_path / "maker.py").write_text("one = 1\n")
    return module


class Maker:
    """Computes arrays and counts the calls."""

    def __init__(self):
        self.calls = 0

    def __call__(self):
        self.calls += 1
        values = np.random.default_rng(0).normal(size=(50, 3))
        return {"values": values, "whole": np.arange(7, dtype=np.int32), "names": np.array(["brain", "skull"])}


def same(first, second):
    return first.keys() == second.keys() and all(
        first[key].dtype == second[key].dtype
        and first[key].shape == second[key].shape
        and first[key].tobytes() == second[key].tobytes()
        for key in first
    )


def test_the_folder_is_the_users(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("NGBRAIN_CACHE", raising=False)
    assert cache_folder() == tmp_path / ".cache" / "ngbrain"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "ngbrain"
    monkeypatch.setenv("NGBRAIN_CACHE", str(tmp_path / "own"))
    assert cache_folder() == tmp_path / "own"


def test_made_once_and_the_same_bits_again(folder, module):
    make = Maker()
    first = load_or_compute("mesh", {"size": 2e-3}, [module], make)
    again = load_or_compute("mesh", {"size": 2e-3}, [module], make)
    assert make.calls == 1 and same(first, again)
    (file,) = folder.iterdir()  # and no temporary one
    assert file.name.startswith("mesh-") and file.suffix == ".npz"


def test_the_order_of_keys_does_not_matter(folder, module):
    make = Maker()
    load_or_compute("mesh", {"a": 1, "b": 2}, [module], make)
    load_or_compute("mesh", {"b": 2, "a": 1}, [module], make)
    assert make.calls == 1


def test_made_again_from_anything_else(folder, module):
    make = Maker()
    load_or_compute("mesh", {"size": 2e-3}, [module], make)
    load_or_compute("mesh", {"size": 2e-3 + 1e-18}, [module], make)
    load_or_compute("labels", {"size": 2e-3}, [module], make)
    with open(module.__file__, "a") as source:
        source.write("two = 2\n")
    load_or_compute("mesh", {"size": 2e-3}, [module], make)
    assert make.calls == 4 and len(list(folder.iterdir())) == 4


def test_an_entry_that_was_changed_is_made_again(folder, module):
    """The points are doubled; the archive itself is intact."""
    make = Maker()
    first = load_or_compute("mesh", 1, [module], make)
    (file,) = folder.iterdir()
    with np.load(file) as found:
        np.savez(
            file,
            **{
                name: found[name] * (2 if name == "values" else 1) if name != "names" else found[name] for name in first
            },
            **{_DIGEST: found[_DIGEST]},
        )
    assert same(load_or_compute("mesh", 1, [module], make), first) and make.calls == 2


def test_the_key_is_made_of_all_code_that_makes_an_entry():
    """The mesh of a head with a cleft depends on `mesh/geometry/cleft.py`, but not on modules that only use the mesh."""
    for name in ("surgery/head_models", "mesh/routes/craniotomy"):
        found = {path.relative_to(PACKAGE).as_posix() for path in source_files([f"ngbrain.{name.replace('/', '.')}"])}
        assert {
            f"{name}.py",
            "mesh/geometry/cleft.py",
            "mesh/geometry/cleft_walls.py",
            "mesh/tet_mesh.py",
            "mesh/routes/cleft_head.py",
        } <= found
        assert not any(path.startswith(("report", "cli", "inverse")) for path in found)


def test_imports_are_followed_however_they_are_written(tmp_path, monkeypatch):
    lines = {
        "one.py": "import ngbrain.tensors\nfrom ngbrain import units",
        "two.py": "def f():\n    from ngbrain.mesh.geometry import cleft\n",
        "three.py": "from ngbrain.mesh import Cleft\n",
    }
    found = {}
    for name, text in lines.items():
        (tmp_path / name).write_text(text)
        module = types.ModuleType(name.removesuffix(".py"))
        module.__file__ = str(tmp_path / name)
        monkeypatch.setitem(sys.modules, module.__name__, module)
        found[name] = {path.name for path in source_files([module.__name__])}
    assert {"one.py", "tensors.py", "units.py"} <= found["one.py"]
    assert {"two.py", "cleft.py", "errors.py"} <= found["two.py"]
    assert {"three.py", "cleft.py", "errors.py"} <= found["three.py"]  # through the package, which hands it on
    assert not {"__init__.py", "primitives.py"} & found["three.py"]  # and nothing else that it could hand on


def flipped(good):
    middle = good.index(np.arange(7, dtype=np.int32).tobytes()) + 5
    return good[:middle] + bytes([good[middle] ^ 1]) + good[middle + 1 :]


@pytest.mark.parametrize(
    "damage",
    [
        lambda good: good[: len(good) // 2],
        lambda good: good[:-1],
        lambda good: b"",
        lambda good: b"no arrays in here",
        flipped,
    ],
    ids=["half", "one byte short", "empty", "garbage", "one bit flipped"],
)
def test_a_damaged_file_is_made_again(folder, module, damage):
    make = Maker()
    first = load_or_compute("mesh", 1, [module], make)
    (file,) = folder.iterdir()
    good = file.read_bytes()
    file.write_bytes(damage(good))
    assert same(load_or_compute("mesh", 1, [module], make), first) and make.calls == 2
    assert same(load_or_compute("mesh", 1, [module], make), first) and make.calls == 2  # and kept
    assert list(folder.iterdir()) == [file]


def test_without_a_folder_to_write_to_the_arrays_still_come(tmp_path, module, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    make = Maker()
    for place in (blocked, blocked / "below"):
        monkeypatch.setenv("NGBRAIN_CACHE", str(place))
        assert same(load_or_compute("mesh", 1, [module], make), make())
    assert blocked.read_text() == "not a folder"


def test_without_room_no_temporary_file_is_left(folder, module, monkeypatch):
    def full(path, **arrays):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    make = Maker()
    assert same(load_or_compute("mesh", 1, [module], make), make())
    assert list(folder.iterdir()) == []


def test_what_fails_to_be_made_is_not_kept(folder, module):
    def fail():
        raise RuntimeError("no mesh")

    with pytest.raises(RuntimeError, match="no mesh"):
        load_or_compute("mesh", 1, [module], fail)
    assert not folder.exists()
