"""Equal tasks of several kinds, importable by workers; a task returns its CPU time (s) and a digest of what it found."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from _ladder import cases
from _work import NOISE, quiet, waves

from ngbrain import ladder, parallel
from ngbrain.image import LabelMap, Volume
from ngbrain.inverse import invert, invert_in_space
from ngbrain.mesh import ROUTES, RadialSizeField
from ngbrain.surrogate import data

Found = tuple[float, str]


def empty(count: int) -> list[parallel.Task]:
    """Of nothing."""
    return [parallel.Task(f"empty {i}", nothing, (i,)) for i in range(count)]


def warm(workers: int) -> list[parallel.Task]:
    """That import what the others need, one a worker."""
    return [parallel.Task(f"warm {i}", imported, ()) for i in range(workers)]


def several(kind: str, count: int) -> list[parallel.Task]:
    """Of a kind, different from each other by a seed."""
    return [parallel.Task(f"{kind} {i}", timed, (kind, i)) for i in range(count)]


def nothing(number: int, *, callback: parallel.Callback) -> int:
    """What it is given."""
    return number


def imported(*, callback: parallel.Callback) -> None:
    """Long enough for every worker to get one."""
    time.sleep(1.0)


def timed(kind: str, seed: int, *, callback: parallel.Callback) -> Found:
    """A task of a kind."""
    quiet()
    begun = time.process_time()
    arrays = WORK[kind](seed)
    taken = time.process_time() - begun
    return taken, hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


def labels(seed: int) -> list[Any]:
    """A mesh of labels of a head made of ellipsoids, another size for each seed, elements of 10 mm."""
    half = (1 + 0.02 * seed) * np.array([0.068, 0.085, 0.06])
    shape = np.array([100, 120, 90])
    place = [(np.arange(n) - n / 2) * 1.5e-3 for n in shape]
    far = np.sqrt(sum((axis / h) ** 2 for axis, h in zip(np.meshgrid(*place, indexing="ij"), half, strict=True)))
    numbers = np.select([far < 0.3, far < 0.8, far < 1.0], [3, 2, 1], 0).astype(np.int16)
    affine = np.diag([1.5e-3] * 3 + [1.0])
    affine[:3, 3] = [axis[0] for axis in place]
    head = LabelMap(Volume(numbers, affine), {1: "cortex", 2: "white", 3: "ventricle"})
    made = ROUTES["conforming"].make(head, RadialSizeField(10e-3, 10e-3)).elements
    return [made.points, made.tets]


def plane(seed: int) -> list[Any]:
    """An inversion of a slice of 11 by 11 points."""
    found = invert(
        waves(11, 3e-3, 2, seed),
        noise=NOISE,
        uniform=False,
        max_iterations=2,
        regulariser="smooth",
        drop_outliers=False,
    )
    return [found.maps[name] for name in sorted(found.maps)]


def cell(seed: int) -> list[Any]:
    """An inversion of a small zone in space."""
    found = invert_in_space(waves(8, 4e-3, 3, seed), noise=NOISE, max_iterations=2, drop_outliers=False)
    return [found.maps[name] for name in sorted(found.maps)]


def rung(seed: int) -> list[Any]:
    """A scene of the ladder, climbed."""
    case = cases()[SCENE]
    found = ladder.solve(case.scene, richest=case.richest)
    return [np.array(sorted(found["answers"].values()))]


def samples(seed: int) -> list[Any]:
    """Waves to train with."""
    block = data.dataset._block("compression", "sinc", seed, "test", range(4), 51, callback=lambda *_: 1)
    return [block[name] for name in sorted(block)]


SCENE = "bar pulled 0.1 mm"
WORK: dict[str, Callable[[int], list[Any]]] = {
    "labels": labels, "slice": plane, "cell": cell, "rung": rung, "samples": samples,
}  # fmt: skip
