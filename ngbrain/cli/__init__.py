"""The command line: thin over the library. Exit 0 on success, 2 on bad input, 3 when a solver gave up."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ngbrain.cli.calibrate import add_calibrate
from ngbrain.cli.invert import add_invert
from ngbrain.cli.ladder import add_solve
from ngbrain.cli.mesh import add_mesh
from ngbrain.cli.predict import add_predict
from ngbrain.errors import InputError, MissingExtra, SolverError, require
from ngbrain.io import write_json
from ngbrain.progress import ProgressBar
from ngbrain.scene import Scene
from ngbrain.surgery.heads import likewise
from ngbrain.surgery.retraction import CHECKS, solve

LEFTWARD = re.compile(r"-[\d.][^,]*(,[^,]+){2}")
"""Three numbers with commas, the first of them negative."""
EXIT_INPUT, EXIT_SOLVER, EXIT_INTERRUPTED = 2, 3, 130
NOT_OF_THE_SCENE = ("-", "checkpoint", "result")
"""How a field begins that an option or another file gave."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a verb; returns the exit status."""
    arguments = _parser().parse_args(_joined(sys.argv[1:] if argv is None else argv))
    try:
        return int(arguments.verb(arguments) or 0)
    except (InputError, MissingExtra) as error:
        print(f"ngbrain: {error}", file=sys.stderr)
        return EXIT_INPUT
    except OSError as error:
        print(f"ngbrain: {error.filename or arguments.output}: {error.strerror or error}", file=sys.stderr)
        return EXIT_INPUT
    except SolverError as error:
        print(f"ngbrain: {error}; the steps so far are in {arguments.output}", file=sys.stderr)
        return EXIT_SOLVER
    except KeyboardInterrupt:
        resumed = f"; go on with --resume -o {arguments.output}" if hasattr(arguments, "resume") else ""
        print(f"ngbrain: stopped{resumed}", file=sys.stderr)
        return EXIT_INTERRUPTED


def _joined(argv: Sequence[str]) -> list[str]:
    """Arguments in which `--site -20,0,30` is `--site=-20,0,30`: a place left of the middle is no option.

    >>> _joined(["mesh", "--site", "-20,0,30", "-q"])
    ['mesh', '--site=-20,0,30', '-q']
    """
    joined: list[str] = []
    for text in argv:
        if LEFTWARD.fullmatch(text) and joined and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] += f"={text}"
        else:
            joined.append(text)
    return joined


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="ngbrain", description="In silico brain surgery.")
    verbs = parser.add_subparsers(required=True, metavar="VERB")
    demo = verbs.add_parser("demo", help="a retraction on the demonstration head, three ways")
    which = demo.add_mutually_exclusive_group()
    which.add_argument("--head", choices=["mni152", "idealised"], default="mni152", help="which head (mni152)")
    which.add_argument(
        "--image", metavar="FILE", help="a T1 scan (NIfTI), with skull or without, to operate on instead"
    )
    demo.add_argument("--fast", action="store_true", help="a coarse mesh and shorter protocols")
    demo.set_defaults(verb=_demo)
    retract = verbs.add_parser("retract", help="one scene")
    retract.add_argument("scene", type=Path, metavar="SCENE.toml", help="what to do; `ngbrain demo` runs a shipped one")
    retract.add_argument(
        "--template", action=_Template, nargs=0, help="print a commented scene to start from, and stop"
    )
    retract.set_defaults(verb=_retract)
    mesh = add_mesh(verbs)
    invert, predict, loaded = add_invert(verbs), add_predict(verbs), add_solve(verbs)
    stiff = add_calibrate(verbs)
    folders = (
        (demo, "demo"), (retract, "out"), (mesh, "head.vtkhdf"), (invert, "inverted"), (predict, "predicted"),
        (loaded, "solved"), (stiff, "calibrated"),
    )  # fmt: skip
    assembling = invert, predict, loaded, stiff
    for verb, folder in folders:
        kind = "FILE" if verb is mesh else "DIR"
        verb.add_argument(
            "-o", dest="output", type=Path, default=Path(folder), metavar=kind, help=f"where results go ({folder})"
        )
        if verb in (demo, retract, stiff):
            verb.add_argument("--resume", action="store_true", help="go on with a run that was stopped")
        verb.add_argument(
            "--threads",
            type=_positive,
            default=1 if verb in assembling else os.cpu_count() or 1,
            metavar="N",
            help="for assembly (1)" if verb in assembling else "processes side by side",
        )
        verb.add_argument("-q", dest="quiet", action="store_true", help="no progress bar")
    return parser


class _Template(argparse.Action):
    """Print a scene that says what can be in one."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(Scene.template(), end="")
        parser.exit()


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a number of threads")
    return number


def _demo(arguments: argparse.Namespace) -> None:
    name = "idealised" if arguments.head == "idealised" else "demo"
    scene = Scene.shipped(f"{name}_fast" if arguments.fast else name)
    if arguments.image:
        scene = likewise(scene, arguments.image)
    _run(scene, "demo", arguments)


def _retract(arguments: argparse.Namespace) -> None:
    try:
        _run(Scene.from_toml(arguments.scene), "retract", arguments)
    except InputError as error:
        if error.file or error.field.startswith(NOT_OF_THE_SCENE):
            raise
        raise InputError(error.field, error.value, error.wanted, arguments.scene) from error


def _run(scene: Scene, verb: str, arguments: argparse.Namespace) -> None:
    for package in ("matplotlib", "jinja2"):  # before the work, not after it
        require(package, "report")
    folder: Path = arguments.output
    if folder.exists() and not folder.is_dir():
        raise InputError("-o", str(folder), "a folder, or a name that is free")
    with ProgressBar(len(scene.protocols) + CHECKS, arguments.quiet) as bar:
        result = solve(scene, folder, arguments.threads, arguments.resume, bar.tell)
    result["verb"] = verb
    write_json(folder / "result.json", result)
    from ngbrain.report import build

    report = build(folder)
    if not arguments.quiet:
        print(_summary(result), f"report: {report}", sep="\n")


def _summary(result: dict[str, Any]) -> str:
    lines = [
        f"{'protocol':<14}{'peak mmHg':>10}{'tip mmHg':>10}{'force N':>9}{'s > 20':>8}{'dose mmHg min':>15}{'MPS p95':>9}"
    ]
    for name, a in result["answers"].items():
        lines.append(
            f"{name:<14}{a['peak_pressure_mmHg']:>10.1f}{a['peak_tip_pressure_mmHg']:>10.1f}{a['peak_force_N']:>9.2f}"
            f"{a['s_above_20_mmHg']:>8.0f}{a['dose_mmHg_min']:>15.0f}{a['mps_p95']:>9.3f}"
        )
    return "\n".join([*lines, *_worth(result["worth"])])


def _worth(errors: dict[str, Any]) -> list[str]:
    """Of the peak and of strain, in a line each, where they are known."""
    lines = []
    for key, name, unit in (("peak_pressure_mmHg", "peak", " mmHg"), ("mps_p95", "MPS p95", "")):
        of = errors.get(key, {})
        parts = [f"{kind} {of[kind]:.2g}" for kind in ("mesh", "order", "step") if of.get(kind) is not None]
        if parts:
            low, high = of["material"]
            between = f"with other published tissue {low:.3g} to {high:.3g}{unit}"
            lines.append(f"of a hold: {name} {of['value']:.3g}{unit}, moved by {', '.join(parts)}{unit}; {between}")
    return lines
