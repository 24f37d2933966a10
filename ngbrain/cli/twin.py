"""The verb `twin`: one patient's plans compared."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ngbrain.cli.words import conclude
from ngbrain.errors import InputError, require
from ngbrain.parallel import open_executor
from ngbrain.progress import LOG, Progress, RunProgress, terminal
from ngbrain.report.pages import twin as page
from ngbrain.surgery.quantities import QUANTITIES
from ngbrain.surgery.twin.case import Case
from ngbrain.workflows.twin import task_count, twin

OWN = ("case", "plan", "stiffness", "norm", "link", "lesion", "craniotomy", "scene", "structures", "scheme", "title")
"""Beginnings of fields that are keys of the case file."""


def run(arguments: argparse.Namespace) -> None:
    """Read, compute, write, report, print."""
    for package in ("matplotlib", "jinja2"):
        require(package, "report")
    case = Case.from_toml(arguments.case)
    folder: Path = arguments.output
    bar = RunProgress(task_count(case, arguments.draws, arguments.quick))
    with Progress(terminal(arguments.quiet), bar, "head and mesh") as progress:

        def extend(result: dict[str, Any]) -> None:
            page.build(folder / "report.html", result)

        try:
            with open_executor(arguments.executor) as executor:
                result = twin(
                    case,
                    folder,
                    draws=arguments.draws,
                    quick=arguments.quick,
                    threads=arguments.threads,
                    resume=arguments.resume,
                    callback=progress.callback,
                    checkpoint=extend,
                    executor=executor,
                ).to_dict()
        except InputError as error:
            if error.file or not error.field.startswith(OWN):
                raise
            raise InputError(error.field, error.value, error.wanted, arguments.case) from error
    for text in result["warnings"]:
        LOG.warning("warning: %s", text)
    conclude(arguments.quiet, [*summary(result), f"report: {folder / 'report.html'}"], [])


def summary(result: dict[str, Any]) -> list[str]:
    """Lines of the summary: plans side by side, decisions.

    Parameters
    ----------
    result : dict
        Of `twin`.

    Returns
    -------
    list of str
    """
    plans = list(result["answers"])
    labels = {key: QUANTITIES[key].label for key in result["answers"][plans[0]]}
    width = max(map(len, labels.values()))
    lines = [" " * width + "".join(f"{plan[:30]:>32}" for plan in plans)]
    for key, label in labels.items():
        cells = []
        for plan in plans:
            found = result["answers"][plan][key]
            low, high = found["interval_95"]
            cells.append(f"{found['median']:>10.3g} ({low:.3g} to {high:.3g})")
        lines.append(f"{label:<{width}}" + "".join(f"{c:>32}" for c in cells))
    return [*lines, "", *result["conclusion"]]
