"""The verb `solve`: a body under loads, or an operation, by the cheapest model that answers what is asked."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ngbrain import ladder
from ngbrain.cli import EXIT_SOLVER
from ngbrain.cli.words import conclude
from ngbrain.errors import InputError, require
from ngbrain.fields import read_toml
from ngbrain.parallel import open_executor
from ngbrain.progress import LOG, Progress, terminal
from ngbrain.report import ladder as page
from ngbrain.scene import Scene
from ngbrain.scene.loading import Loading
from ngbrain.surgery import adequate


def run(arguments: argparse.Namespace) -> int:
    """Read, climb, write, report, print."""
    for package in ("matplotlib", "jinja2"):
        require(package, "report")
    folder: Path = arguments.output
    scene = _read(arguments.scene)
    with Progress(terminal(arguments.quiet)) as line, open_executor(arguments.executor) as executor:
        how: dict[str, Any] = {"threads": arguments.threads, "tell": line.tell, "executor": executor}
        if isinstance(scene, Scene):
            result = adequate.solve(scene, folder, **how).to_dict()
        else:
            result = ladder.solve(scene, folder, **how).to_dict()
    for text in result["warnings"]:
        LOG.warning("warning: %s", text)
    report = page.build(folder / "report.html", result)
    doubts = [f"doubt: {flag}" for flag in result["flags"]]
    conclude(arguments.quiet, [*summary(result), f"report: {report}"], doubts)
    if unknown := [name for name, error in result["error"].items() if error is None]:
        LOG.warning("how far these are off is not known: %s", ", ".join(unknown))
        return EXIT_SOLVER
    return 0


def _read(path: Path) -> Scene | Loading:
    """An operation, which has a cleft, or a loaded body. Raises `InputError` for an operation without a question."""
    if "cleft" not in read_toml(path):
        return Loading.from_toml(path)
    scene = Scene.from_toml(path)
    if not scene.ask:
        raise InputError("ask", "missing", "one or more tables [[ask]]; `retract` computes what is described", path)
    return scene


def summary(result: dict[str, Any]) -> list[str]:
    """The result as lines: answers, what was left out."""
    lines = [f"{'question':<44}{'answer':>14}{'missing':>10}{'asked':>9}"]
    lines += [
        f"{name:<44}{value:>14}{error:>10}{tolerance:>9}" for name, value, error, tolerance in page.answers(result)
    ]
    lines += ["", f"{'left out':<58}{'would change':>12}"]
    lines += [f"{what:<58}{change:>12}" for what, change, *_ in page.left_out(result)]
    return [*lines, "", "model: " + ", ".join(f"{axis} {level}" for axis, level in result["model"].items())]
