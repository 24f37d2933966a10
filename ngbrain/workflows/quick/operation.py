"""First answers of a scene within a minute or two, each with an interval; then the scene as described refines the same result."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ngbrain import parallel
from ngbrain.io import write_json
from ngbrain.parallel import ProcessExecutor
from ngbrain.progress import LOG, log_progress
from ngbrain.reading import read_json
from ngbrain.scene import Protocol, Scene
from ngbrain.scene.result import SceneResult
from ngbrain.surgery import retraction
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.quantities import QUANTITIES
from ngbrain.surgery.uncertainty.coarse_answers import MAIN, coarse_scene, has_coarse, shipped_record
from ngbrain.surgery.uncertainty.error_budget import NOT_COMPUTED, UNDER_WAY
from ngbrain.workflows.quick.first_answers import Result, compare

FOLDER, COARSER = "coarse", "coarser"
"""Folder of the coarse runs within that of the result, and within it that of the coarser ones."""
FIRST, BEFORE = "first answers: ", "coarser: "
"""Prefixes of the coarse runs' names in the progress; names of protocols have no colon."""
TOO_COARSE = "no first answers: the elements on the cleft's walls are hardly smaller than those of first answers"
BASIS = (
    "An interval is the difference between answers on elements of two sizes, {:.3g} and {:.3g} mm on the walls of the cleft, "
    "times a factor by how far the refined answers of {} other scenes, computed beforehand ({}), were off: all of a scene should "
    "lie inside in 9 of 10 scenes."
)


def has_first_answers(folder: str | Path | None) -> bool:
    """Whether a folder has a result with first answers, so that a resumed run keeps them.

    Parameters
    ----------
    folder : path, optional

    Returns
    -------
    bool
    """
    path = None if folder is None else Path(folder) / "result.json"
    found = read_json(path, "result") if path is not None and path.exists() else None
    return isinstance(found, dict) and "first_answers" in found


def count_runs(scene: Scene, checks: bool) -> int:
    """Number of runs of a quick operation, for a progress bar.

    Parameters
    ----------
    scene : Scene
    checks : bool

    Returns
    -------
    int
    """
    first = len(scene.protocols) + len(_leading(scene)) if has_coarse(scene) else 0
    return first + len(scene.protocols) + retraction.CHECKS * checks


def solve(
    scene: Scene,
    folder: str | Path | None = None,
    threads: int = 1,
    resume: bool = False,
    callback: parallel.Callback = log_progress,
    checks: bool = True,
    checkpoint: Callable[[Result], None] | None = None,
    executor: parallel.AnyExecutor = None,
) -> SceneResult:
    """First answers of an operation on large elements with their intervals; then the operation as described.

    The result is that of `ngbrain.surgery.retraction.solve`, with `first_answers`. Until all protocols are computed as described,
    its numbers are the coarse ones, and refined values are in `first_answers` as they come.

    Parameters
    ----------
    scene, folder, threads, resume, callback, checks, checkpoint, executor
        See `ngbrain.surgery.retraction.solve`. Coarse runs are in `folder/coarse`.

    Returns
    -------
    SceneResult
    """
    if not has_coarse(scene):
        LOG.warning("%s; the scene is computed as described at once", TOO_COARSE)
        return retraction.solve(scene, folder, threads, resume, callback, checks, checkpoint, executor)
    made = _Growing(scene, None if folder is None else Path(folder), checks, checkpoint)
    with ExitStack() as stack:
        if executor is None and threads > 1:  # one pool for all
            executor = stack.enter_context(ProcessExecutor(threads, threads=threads))
        shared: dict[str, Any] = {"threads": threads, "resume": resume, "executor": executor}
        if not (resume and made.restore()):
            where = made.folder and made.folder / FOLDER
            leading = replace(coarse_scene(scene, coarser=True), protocols=_leading(scene))
            coarser = retraction.solve(
                leading, where and where / COARSER, callback=_named(callback, BEFORE), checks=False, **shared
            )
            made.coarser = coarser["answers"]
            retraction.solve(
                coarse_scene(scene),
                where,
                callback=_named(callback, FIRST),
                checks=False,
                store=made.first,
                early=True,
                **shared,
            )
        found = retraction.solve(scene, folder, callback=callback, checks=checks, store=made.described, **shared)
    return SceneResult(made.result, status=found.status, warnings=found.warnings)


def _leading(scene: Scene) -> tuple[Protocol, ...]:
    """The shortest protocol of those by travel, and of those by force: computed on both coarse meshes."""
    programs = [(asked, len(RetractionModel.program(scene, asked).times)) for asked in scene.protocols]
    found = []
    for by_force in (False, True):
        alike = [(length, asked) for asked, length in programs if (asked.kind == "force") is by_force]
        found += [min(alike, key=lambda each: each[0])[1]] if alike else []
    return tuple(found)


def _named(callback: parallel.Callback, prefix: str) -> parallel.Callback:
    return callback if callback is log_progress else lambda name, *rest: callback(prefix + name, *rest)


@dataclass
class _Growing:
    """The result while it grows: coarse, then as described, then with checks."""

    scene: Scene
    folder: Path | None
    checks: bool
    checkpoint: Callable[[Result], None] | None
    coarser: Mapping[str, Any] = field(default_factory=dict)
    result: Result = field(default_factory=dict)
    started: float = field(default_factory=time.perf_counter)

    def restore(self) -> bool:
        """Take up the result in the folder if its first answers are complete."""
        if self.folder is None or not has_first_answers(self.folder):
            return False
        kept = read_json(self.folder / "result.json", "result")
        protocols = {each["protocol"] for each in kept["first_answers"]["answers"]}
        if kept.get("scene") != self.scene.to_dict():
            return False
        self.result = kept
        return protocols == {asked.name for asked in self.scene.protocols}

    def first(self, found: Result) -> None:
        """A protocol is done on the coarse mesh."""
        leading = {asked.kind == "force": asked.name for asked in _leading(self.scene)}
        if any(name not in found["answers"] for name in leading.values()):
            return
        seconds = self.result["first_answers"]["time_s"] if self.result else time.perf_counter() - self.started
        record, coarse = shipped_record(), coarse_scene(self.scene).mesh
        coarser = coarse_scene(self.scene, coarser=True).mesh
        sizes = 1e3 * coarser.wall, 1e3 * coarse.wall
        answers = []
        for asked in self.scene.protocols:
            if (own := found["answers"].get(asked.name)) is None:
                continue
            lead = leading[asked.kind == "force"]
            for name in MAIN:
                both = found["answers"][lead][name], self.coarser[lead][name]
                interval = record.interval(name, own[name], *both)
                answers.append(
                    {
                        "protocol": asked.name,
                        "quantity": name,
                        "name": QUANTITIES[name].name,
                        "unit": QUANTITIES[name].unit,
                        "value": own[name],
                        "interval": interval and list(interval),
                        "refined": None,
                        "inside": None,
                    }
                )
        self._publish(
            {
                **found,
                "scene": self.scene.to_dict(),
                "check_status": dict.fromkeys(found["check_status"], UNDER_WAY if self.checks else NOT_COMPUTED),
                "runs_in": FOLDER,
                "first_answers": {
                    "model": f"elements of {sizes[1]:.3g} mm on the walls of the cleft",
                    "basis": BASIS.format(*sizes, record.scenes, record.made),
                    "time_s": seconds,
                    "refined": False,
                    "answers": answers,
                },
            }
        )

    def described(self, found: Result) -> None:
        """A protocol is done as described, or a check: numbers are replaced when all protocols are."""
        whole = UNDER_WAY not in found["protocol_status"].values()
        first = compare(self.result["first_answers"], lambda each: _number(found, each))
        base = found | {"time_s": time.perf_counter() - self.started} if whole else self.result
        self._publish(base | {"first_answers": first | {"refined": whole or first["refined"]}})

    def _publish(self, result: Result) -> None:
        self.result = result
        if self.folder is not None:
            write_json(self.folder / "result.json", result)
        if self.checkpoint is not None:
            self.checkpoint(result)


def _number(found: Result, each: Mapping[str, Any]) -> float | None:
    answer = found["answers"].get(each["protocol"])
    return each["refined"] if answer is None else answer[each["quantity"]]
