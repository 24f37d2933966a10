"""The verbs `demo` and `simulate`: a scene to its answers, a report and a summary."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ngbrain.cli import EXIT_SOLVER
from ngbrain.cli.places import PREVIEW
from ngbrain.cli.words import conclude
from ngbrain.errors import InputError, require
from ngbrain.io import write_json
from ngbrain.parallel import open_executor
from ngbrain.progress import LOG, Progress, RunProgress, terminal
from ngbrain.report.pages import first_answers
from ngbrain.report.pages import ladder as page
from ngbrain.scene import Scene
from ngbrain.surgery.head_models import transfer_scene
from ngbrain.surgery.retraction import CHECKS
from ngbrain.surgery.uncertainty.error_budget import FAILED, NOT_COMPUTED, UNDER_WAY
from ngbrain.workflows.preview import draw
from ngbrain.workflows.quick.operation import count_runs, has_first_answers
from ngbrain.workflows.simulate import simulate

NOT_OF_THE_SCENE = ("-", "checkpoint", "result", "executor", "worker", "memory")
"""Prefixes of message fields that refer to an option or another file."""
FIRST, PROTOCOLS, CHECKED = "first answers", "protocols", "checked"
"""What is printed, once each: first answers, the summary of all protocols, and that checks have been added to the report."""


def run(arguments: argparse.Namespace) -> int:
    """Read, compute, write, report, print."""
    for package in ("matplotlib", "jinja2"):  # before the work, not after it
        require(package, "report")
    if arguments.verb == "demo":
        return _operate(_demo(arguments), arguments)
    scene = Scene.from_toml(arguments.scene)
    try:
        if arguments.preview:
            return _preview(scene, arguments)
        if scene.is_operation and (arguments.as_described or not scene.quantities):
            return _operate(scene, arguments)
        return _answer(scene, arguments)
    except InputError as error:
        if error.file or error.field.startswith(NOT_OF_THE_SCENE):
            raise
        raise InputError(error.field, error.value, error.wanted, arguments.scene) from error


def _demo(arguments: argparse.Namespace) -> Scene:
    name = "idealised" if arguments.head == "idealised" else "demo"
    scene = Scene.shipped(f"{name}_fast" if arguments.fast else name)
    return transfer_scene(scene, arguments.image) if arguments.image else scene


def _preview(scene: Scene, arguments: argparse.Namespace) -> int:
    """Draw the scene without computing it."""
    from ngbrain.workflows.preview import preview

    earlier = " (in place of an earlier one)" if (arguments.output / PREVIEW).exists() else ""
    conclude(arguments.quiet, [f"preview: {preview(scene, arguments.output)}{earlier}"], [])
    return 0


def _answer(scene: Scene, arguments: argparse.Namespace) -> int:
    """Answer the requested quantities by the cheapest model within the tolerances."""
    if arguments.resume:
        raise InputError("--resume", "given", "this option left out: a scene with quantities cannot be resumed")
    folder: Path = arguments.output

    said = set[str]()
    drawing = None if scene.is_operation else draw(scene)

    def extend(found: dict[str, Any]) -> None:
        """Write the report after each model, so that an interrupted search leaves one."""
        path = page.build(folder / "report.html", found, drawing)
        if arguments.quick and not (said or arguments.quiet or found["first_answers"]["refined"]):
            said.add(FIRST)
            line.say("\n".join([*_first_answers(found), f"report: {path} (refinement under way)", ""]))

    with Progress(terminal(arguments.quiet)) as line, open_executor(arguments.executor) as executor:
        result = simulate(
            scene,
            folder,
            as_described=arguments.as_described,
            threads=arguments.threads,
            quick=arguments.quick,
            callback=line.callback,
            checkpoint=extend,
            executor=executor,
        ).to_dict()
    for text in result["warnings"]:
        LOG.warning("warning: %s", text)
    report = page.build(folder / "report.html", result, drawing)
    cautions = [f"caution: {text}" for text in result["cautions"]]
    conclude(arguments.quiet, [*_answers(result), f"report: {report}"], cautions)
    if unknown := [each["quantity"] for each in result["answers"] if each["error_estimate"] is None]:
        LOG.warning("the errors of these are not known: %s", ", ".join(unknown))
        return EXIT_SOLVER
    return 0


def _answers(result: dict[str, Any]) -> list[str]:
    """Lines of the result: answers, what was left out."""
    lines = [f"{'quantity':<44}{'value':>14}{'error':>10}{'tolerance':>11}"]
    lines += [
        f"{name:<44}{value:>14}{error:>10}{tolerance:>11}" for name, value, error, tolerance in page.answers(result)
    ]
    lines += ["", f"{'omitted effect':<58}{'change':>12}"]
    lines += [f"{what:<58}{change:>12}" for what, change, *_ in page.omitted_effects(result)]
    return [*lines, "", "model: " + ", ".join(f"{axis} {level}" for axis, level in result["model"].items())]


def _operate(scene: Scene, arguments: argparse.Namespace) -> int:
    """Compute an operation as described."""
    folder: Path = arguments.output
    from ngbrain.report.pages.retraction import Report

    report, pages, said = Report(folder), list[Path](), set[str]()
    quick = arguments.quick or (arguments.resume and has_first_answers(folder))
    number = count_runs(scene, arguments.checks) if quick else len(scene.protocols) + CHECKS * arguments.checks
    runs = RunProgress(number)
    with Progress(terminal(arguments.quiet), runs, "head and mesh") as progress:

        def extend(result: dict[str, Any]) -> None:
            """Write the report after each protocol and after each check."""
            result["verb"] = arguments.verb
            write_json(folder / "result.json", result)
            pages.append(report.write())
            if len(pages) == 1:
                for text in scene.warnings:
                    LOG.warning("warning: %s", text)
            first = result.get("first_answers")
            stage = FIRST if first and not first["refined"] else PROTOCOLS
            if stage in said or (stage == PROTOCOLS and UNDER_WAY in result.get("protocol_status", {}).values()):
                return
            said.add(stage)
            if arguments.quiet:
                return
            if stage == FIRST:
                progress.say("\n".join([*_first_answers(result), f"report: {pages[-1]} (refinement under way)"]))
                return
            later = " (checks under way)" if UNDER_WAY in result["check_status"].values() else ""
            said.update({CHECKED} if later else ())
            progress.say("\n".join([*_summary(result["answers"]), f"report: {pages[-1]}{later}"]))

        with open_executor(arguments.executor) as executor:
            result = simulate(
                scene,
                folder,
                as_described=True,
                threads=arguments.threads,
                resume=arguments.resume,
                checks=arguments.checks,
                quick=arguments.quick,
                callback=progress.callback,
                checkpoint=extend,
                executor=1 if executor is None and arguments.executor else executor,
            )
    if failed := _checks_that(FAILED, result):
        LOG.warning("warning: checks that failed, so that error estimates are missing: %s", failed)
    cautions = _error_budget_cautions(result["error_budget"])
    if left_out := _checks_that(NOT_COMPUTED, result):
        cautions.append(f"error estimates not computed: {left_out}")
    conclude(arguments.quiet, [], cautions)
    if CHECKED in said:
        print(f"report, with the checks: {pages[-1]}")
    return 0


def _first_answers(result: dict[str, Any]) -> list[str]:
    """First answers with their intervals, a line each."""
    found = first_answers.rows(result["first_answers"])
    rows = [
        (f"{protocol}: {name}" if protocol else name, value, interval) for protocol, name, value, interval, *_ in found
    ]
    width = max(len(name) for name, *_ in rows)
    lines = [f"{'first answer':<{width}}{'coarse':>16}   interval of the refined one"]
    return lines + [f"{name:<{width}}{value:>16}   {interval}" for name, value, interval in rows]


def _checks_that(status: str, result: Mapping[str, Any]) -> str:
    return ", ".join(name for name, found in result["check_status"].items() if found == status)


def _summary(answers: dict[str, Any]) -> list[str]:
    lines = [
        f"{'protocol':<14}{'peak mmHg':>10}{'tip mmHg':>10}{'force N':>9}{'s > 20':>8}{'dose mmHg min':>15}{'MPS p95':>9}"
    ]
    for name, a in answers.items():
        lines.append(
            f"{name:<14}{a['peak_pressure_mmHg']:>10.1f}{a['peak_tip_pressure_mmHg']:>10.1f}{a['peak_force_N']:>9.2f}"
            f"{a['s_above_20_mmHg']:>8.0f}{a['dose_mmHg_min']:>15.0f}{a['mps_p95']:>9.3f}"
        )
    return lines


def _error_budget_cautions(errors: dict[str, Any]) -> list[str]:
    """Errors of peak pressure and strain, a line each, where they are known."""
    lines = []
    for key, name, unit in (("peak_pressure_mmHg", "peak", " mmHg"), ("mps_p95", "MPS p95", "")):
        of = errors.get(key, {})
        parts = [f"{kind} {of[kind]:.2g}" for kind in ("mesh", "order", "step") if of.get(kind) is not None]
        if parts:
            low, high = of["material"]
            between = f"other published tissue: {low:.3g} to {high:.3g}{unit}"
            lines.append(
                f"opening held to the end: {name} {of['value']:.3g}{unit}, errors: {', '.join(parts)}{unit}; {between}"
            )
    return lines
