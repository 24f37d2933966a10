"""Finished work: keys of calls, stored results, refusals."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.io import FinishedWork
from ngbrain.io import cache as cache_module


@dataclass
class Case:
    name: str
    values: np.ndarray


def work(*args):
    return args


def other(*args):
    return args


ARRAY = np.arange(4.0)
DIFFERENT = [
    (), (1,), (1.0,), (True,), ("1",), (b"1",), (None,), (1, 2), ((1, 2),), ([1, 2],), (range(1, 3),), ("ab", "c"), ("a", "bc"),
    (ARRAY,), (ARRAY.astype(np.float32),), (ARRAY.reshape(2, 2),), (ARRAY + 1e-16 * (ARRAY == 0),), ({"a": 1},), ({"a": 1.0},),
    ({"b": 1},), (Case("a", ARRAY),), (Case("b", ARRAY),), (np.float32(1),), (1j,), (work,), (other,),
]  # fmt: skip


def test_calls_that_differ_have_keys_that_differ(tmp_path):
    kept = FinishedWork(tmp_path)
    keys = [kept.key(work, args) for args in DIFFERENT]
    assert len(set(keys)) == len(keys) and keys == [kept.key(work, args) for args in DIFFERENT]
    assert kept.key(other, (1,)) != kept.key(work, (1,))
    assert kept.key(work, (Path("a"),)) == kept.key(work, ("a",))
    assert kept.key(work, ({"a": 1, "b": 2},)) == kept.key(work, ({"b": 2, "a": 1},))
    strided = np.arange(8.0)[::2]
    assert kept.key(work, (strided,)) == kept.key(work, (strided.copy(),))


def test_another_source_is_another_key(tmp_path, monkeypatch):
    kept = FinishedWork(tmp_path)
    before = kept.key(work, ())
    monkeypatch.setattr(cache_module, "versions", lambda: {"ngsolve": "0"})
    cache_module.code_digest.cache_clear()
    try:
        assert kept.key(work, ()) != before
    finally:
        cache_module.code_digest.cache_clear()


def test_results_come_back_to_the_last_bit(tmp_path):
    kept = FinishedWork(tmp_path / "new" / "folder")
    result = {"maps": [ARRAY / 3, (1, None, np.float32(0.1))], "name": "a", "n": 3}
    with pytest.raises(KeyError):
        kept.find("key")
    kept.keep("key", result)
    found = kept.find("key")
    np.testing.assert_array_equal(found["maps"][0], ARRAY / 3)
    assert found["maps"][1] == (1, None, np.float32(0.1)) and found["name"] == "a"
    assert [path.name for path in kept.folder.iterdir()] == ["key.npz"]


def test_what_cannot_be_told_or_kept_is_refused(tmp_path):
    kept = FinishedWork(tmp_path)
    with pytest.raises(InputError, match=r"^what work is called with\[0\]\['a'\] is a object"):
        kept.key(work, ({"a": object()},))
    with pytest.raises(InputError, match=r"^state is a set"):
        kept.keep("key", {1, 2})
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"^folder of finished work is .*file; wanted: a folder"):
        FinishedWork(tmp_path / "file")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]
