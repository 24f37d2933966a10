"""The digital twin of one patient, from a case file to the comparison of surgical plans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.io import write_json
from ngbrain.io.waves import read_waves
from ngbrain.parallel import Callback, ProcessExecutor
from ngbrain.progress import RunProgress, log_progress, reporting
from ngbrain.result import Status
from ngbrain.result_file import FileResult
from ngbrain.surgery.twin.case import Case
from ngbrain.surgery.twin.compute import solve
from ngbrain.surgery.twin.stiffness import MeasuredMap
from ngbrain.surgery.twin.waves import map_from_inversion
from ngbrain.workflows.property_maps import finite

DRAWS = 6
"""Whole runs of each plan by default."""
WORK = "work"
"""Folder of finished work."""


@dataclass(repr=False, eq=False)
class TwinResult(FileResult):
    """The compared plans of a patient, with the contents of `result.json`: `result["answers"][plan][measure]`."""

    @property
    def value(self) -> dict[str, Any]:
        """Plan → measure → median and interval."""
        answers: dict[str, Any] = self.data["answers"]
        return answers

    @property
    def headline(self) -> str:
        """The conclusion."""
        return " ".join(self.data["conclusion"])

    @property
    def statistics(self) -> dict[str, float]:
        """Draws, whole runs and wall-clock time."""
        return {**self.data["draws"], "s": round(self.data["time_s"], 1)}

    def plot(self) -> Any:
        """The plans side by side with their intervals."""
        from ngbrain.report.pages.twin import compare_figure

        return compare_figure(self.data)


def task_count(case: Case, draws: int, quick: bool) -> int:
    """Number of tasks of a case, for a progress bar.

    Parameters
    ----------
    case : Case
    draws : int
        Whole runs of each plan.
    quick : bool

    Returns
    -------
    int
    """
    from ngbrain.surgery.twin.compute import TOGETHER

    return len(case.plans) * (1 if quick else 2 + -(-draws // TOGETHER))


@reporting(lambda given: RunProgress(12))
def twin(
    case: Case | str | Path,
    folder: str | Path | None = None,
    *,
    draws: int = DRAWS,
    quick: bool = False,
    threads: int = 1,
    resume: bool = False,
    callback: Callback = log_progress,
    checkpoint: Callable[[dict[str, Any]], None] | None = None,
    executor: parallel.AnyExecutor = None,
) -> TwinResult:
    """Compare surgical plans for one patient, with what is not known of the tissue carried through.

    Parameters
    ----------
    case : Case, str or Path
        The patient and the plans, or the case file (`ngbrain twin --template`).
    folder : str or Path, optional
        Where `result.json` and finished work go; None writes nothing.
    draws : int
        Whole nonlinear runs of each plan, with draws of the patient that the plans share: they check and correct the linearised
        intervals.
    quick : bool
        A first answer: coarse elements, the linearisation alone.
    threads : int
        Processes side by side.
    resume : bool
        Go on from the finished work in `folder`.
    callback : callable, optional
        Called with (task, its time in s, share done).
    checkpoint : callable, optional
        Called with the result as soon as all plans are linearised, and again when it is complete.
    executor : int or concurrent.futures.Executor, optional
        Who computes (`ngbrain.parallel.run`).

    Returns
    -------
    TwinResult
        Reads as `result.json` does.

    Raises
    ------
    InputError
        A case that cannot be used.
    SolverError
        A plan's run gives up.

    Examples
    --------
    A case to begin with is printed by `ngbrain twin --template`:

    >>> from ngbrain.surgery.twin.case import Case
    >>> [line for line in Case.template().splitlines() if line.startswith("name")]
    ['name = "gentle"', 'name = "wide"']

    That case, in some minutes; `ngbrain data twin` writes its files:

    >>> result = twin("twin.toml", "out", quick=True)  # doctest: +SKIP
    >>> result["answers"]["gentle"]["peak_pressure_mmHg"]["interval_95"]  # doctest: +SKIP
    >>> print(result)  # doctest: +SKIP
    """
    if draws < 0 or draws == 1:
        raise InputError("draws", draws, "0, or 2 or more whole runs of each plan")
    if not isinstance(case, Case):
        case = Case.from_toml(case)
    where = None if folder is None else Path(folder).absolute()
    if where is not None:
        where.mkdir(parents=True, exist_ok=True)
        if not resume and (where / WORK).is_dir():
            for old in (where / WORK).glob("*.npz"):
                old.unlink()
    measured = measure(case)

    def extend(result: dict[str, Any]) -> None:
        plain = finite(result) | {"threads": threads}
        if where is not None:
            write_json(where / "result.json", plain)
        if checkpoint:
            checkpoint(plain)

    work = None if where is None else where / WORK
    if executor is None and threads > 1:
        with ProcessExecutor(threads, threads=threads) as processes:
            result = solve(case, measured, work, draws, quick, processes, callback, extend)
    else:
        result = solve(case, measured, work, draws, quick, executor, callback, extend)
    return TwinResult(finite(result) | {"threads": threads}, status=Status.CONVERGED, warnings=result["warnings"])


def measure(case: Case) -> MeasuredMap | None:
    """The patient's map of |G*|: read, or inverted from waves; None where nothing was measured."""
    data = case.stiffness
    if data is None:
        return None
    if data.map is not None:
        return MeasuredMap.read(data)
    return map_from_inversion(invert(read_waves(str(data.waves))))
