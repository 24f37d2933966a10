"""The verb `calibrate`: tissue stiffness of a patient from landmarks and forces of a retraction."""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ngbrain.cli.words import conclude
from ngbrain.errors import InputError, nearest, require
from ngbrain.inverse.optimise.result import Iteration
from ngbrain.io import write_json
from ngbrain.io.versions import versions
from ngbrain.progress import Progress, terminal
from ngbrain.reading import read_json
from ngbrain.report.pages import calibration as page
from ngbrain.scene import Scene
from ngbrain.schema.document import brief
from ngbrain.surgery.calibrate import Calibration, calibrate
from ngbrain.surgery.observations import Observations
from ngbrain.threads import threads
from ngbrain.workflows.property_maps import finite

ROUND = "factors.json"
"""Factors after the last iteration, from which `--resume` starts."""


def run(arguments: argparse.Namespace) -> None:
    """Read, calibrate, write, report, print."""
    started, rounds = time.monotonic(), list[Iteration]()
    scene, seen, protocol = _read_inputs(arguments)
    folder: Path = arguments.output
    start = _read_factors(folder / ROUND) if arguments.resume and (folder / ROUND).exists() else None
    with Progress(terminal(arguments.quiet)) as line, threads(arguments.threads):

        def callback(iteration: Iteration, factors: dict[str, float]) -> None:
            rounds.append(iteration)
            write_json(folder / ROUND, factors)
            line.callback(f"iteration {len(rounds)}, {iteration}")

        line.callback("head, mesh, and the scene's own run")
        tissues = arguments.tissues.split(",") if arguments.tissues else ()
        found = calibrate(
            scene, seen, tissues, protocol, arguments.spread, start=start, callback=callback, finer=arguments.finer
        )
    result = {
        "verb": "calibrate",
        "title": scene.title,
        "versions": versions(),
        "seed": 0,
        "threads": arguments.threads,
        "scene": scene.to_dict(),
        **result_data(scene, seen, found),
        "iterations": [asdict(each) for each in rounds],
        "time_s": time.monotonic() - started,
    }
    result = finite(result)
    found.scene.save(folder / "scene.toml")
    write_json(folder / "result.json", result)
    report = page.build(folder / "report.html", result)
    files = f"the scene with these tissues: {folder / 'scene.toml'}", f"report: {report}"
    conclude(arguments.quiet, [*summary(result), *files], [f"note: {note}" for note in result["warnings"]])


def _read_inputs(arguments: argparse.Namespace) -> tuple[Scene, Observations, int]:
    """Scene, measurements and index of the protocol; errors are reported before the work begins."""
    for package in ("matplotlib", "jinja2"):
        require(package, "report")
    if not (arguments.landmarks or arguments.force):
        raise InputError("--landmarks", "missing", "--landmarks, --force or both")
    for option, table, deviation in (
        ("--landmark-sd", arguments.landmarks, arguments.landmark_sd),
        ("--force-sd", arguments.force, arguments.force_sd),
    ):
        if table and not 0 < (deviation or 0) < math.inf:
            raise InputError(option, deviation, "a standard deviation, a finite number above 0")
    scene = Scene.from_toml(arguments.scene)
    names = [protocol.name for protocol in scene.protocols]
    if arguments.protocol and arguments.protocol not in names:
        raise InputError("--protocol", repr(arguments.protocol), nearest(arguments.protocol, names))
    seen = Observations.read(
        arguments.landmarks, arguments.force, arguments.landmark_sd or 1.0, arguments.force_sd or 1.0
    )
    return scene, seen, names.index(arguments.protocol) if arguments.protocol else 0


def _read_factors(path: Path) -> dict[str, float]:
    """Factors of an interrupted calibration; `calibrate` checks their names."""
    factors = read_json(path, "factors")
    if not isinstance(factors, dict) or not factors:
        raise InputError("factors", brief(factors), "a factor for each tissue, or no such file", path)
    for name, factor in factors.items():
        if not isinstance(factor, int | float) or isinstance(factor, bool) or not 0 < factor < math.inf:
            raise InputError(f"factors.{name}", brief(factor), "a positive number", path)
    return factors


def result_data(scene: Scene, seen: Observations, found: Calibration) -> dict[str, Any]:
    """The calibration as plain data; lengths in mm, forces in N.

    Parameters
    ----------
    scene : Scene
    seen : Observations
    found : Calibration

    Returns
    -------
    dict
    """
    before = {tissue.region: tissue.initial_modulus for tissue in scene.tissues}
    after = {tissue.region: tissue.initial_modulus for tissue in found.scene.tissues}
    level = found.level
    return {
        "tissues": {
            name: {**asdict(band), "modulus_Pa": after[name], "modulus_before_Pa": before[name]}
            | ({} if found.moved is None else {"moved_by_finer_elements": found.moved[name]})
            for name, band in found.factors.items()
        },
        "misfit": {"value": level.misfit, "expected": level.expected, "ratio": level.ratio},
        "converged": found.converged,
        "times_s": seen.times.tolist(),
        "landmarks_mm": (1000 * seen.landmarks).tolist(),
        "seen": _plain(seen.data) | {"landmark_sd_mm": 1000 * seen.sigma[0], "force_sd_N": seen.sigma[1]},
        "fitted": _plain(found.fitted),
        "warnings": _warnings(found),
    }


def _plain(data: Any) -> dict[str, Any]:
    moved = (1000 * data[:, :-1]).reshape(len(data), -1, 3)
    return {"displacements_mm": moved.tolist(), "force_N": data[:, -1].tolist()}


def _warnings(found: Calibration) -> list[str]:
    notes = list(found.warnings)
    if found.level.ratio > page.UNEXPLAINED:
        notes.append(
            f"the misfit is {found.level.ratio:.3g} times its expected value: elements, laws or the blade's position differ "
            "from those of the operation; intervals count the excess as noise"
        )
    if not found.converged:
        notes.append("the optimisation stopped before it converged")
    return notes


def summary(result: dict[str, Any]) -> list[str]:
    """Lines of the summary: factors with their intervals, the misfit."""
    lines = [f"{'tissue':<24}{'factor':>8}{'95 % interval':>18}{'initial modulus':>18}"]
    for name, of in result["tissues"].items():
        interval = f"{of['low']:.3g} to {of['high']:.3g}"
        lines.append(f"{name:<24}{of['value']:>8.3g}{interval:>18}{of['modulus_Pa'] / 1000:>14.3g} kPa")
    lines.append(
        f"misfit: {result['misfit']['ratio']:.3g} times its expected value, after {len(result['iterations'])} iterations"
    )
    return lines
