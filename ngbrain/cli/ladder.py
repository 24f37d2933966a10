"""The verb `solve`: a body under loads, by the cheapest model that answers what is asked."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ngbrain.errors import InputError, require
from ngbrain.ladder import Rung, solve
from ngbrain.progress import ProgressLine
from ngbrain.report import ladder
from ngbrain.scene.loading import Loading


def add_solve(verbs: Any) -> argparse.ArgumentParser:
    """Add the verb to a parser's verbs."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        "solve", help="a loaded body, by the cheapest model that will do"
    )
    parser.add_argument(
        "scene", type=Path, metavar="SCENE.toml", help="body, tissues, loads, and what is asked how accurately"
    )
    parser.set_defaults(verb=run)
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Read, climb, write, report, print."""
    for package in ("matplotlib", "jinja2"):
        require(package, "report")
    folder: Path = arguments.output
    if folder.exists() and not folder.is_dir():
        raise InputError("-o", str(folder), "a folder, or a name that is free")
    scene = Loading.from_toml(arguments.scene)
    with ProgressLine(arguments.quiet) as line:

        def tell(rung: Rung) -> None:
            line.tell(f"{rung.ndof} unknowns, {100 * float(rung.missing.max()):.3g} % missing")

        result = solve(scene, folder, threads=arguments.threads, tell=tell)
    report = ladder.build(folder / "report.html", result)
    if not arguments.quiet:
        print(summary(result), f"report: {report}", sep="\n")


def summary(result: dict[str, Any]) -> str:
    """The result as text: answers, what was left out, doubts."""
    lines = [f"{'question':<44}{'answer':>14}{'missing':>10}{'asked':>9}"]
    lines += [
        f"{name:<44}{value:>14}{error:>10}{tolerance:>9}" for name, value, error, tolerance in ladder.answers(result)
    ]
    lines += ["", f"{'left out':<58}{'would change':>12}"]
    lines += [f"{what:<58}{change:>12}" for what, change, *_ in ladder.left_out(result)]
    lines += ["", "model: " + ", ".join(f"{axis} {level}" for axis, level in result["model"].items())]
    return "\n".join([*lines, *(f"Doubt: {flag}" for flag in result["flags"])])
