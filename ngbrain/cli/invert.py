"""The verb `invert`: property maps from wave data."""

from __future__ import annotations

import argparse
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.cli import EXIT_SOLVER
from ngbrain.cli.predict import runtime_version, surrogate_start
from ngbrain.cli.words import conclude
from ngbrain.errors import InputError, SolverError, file_context, require
from ngbrain.inverse.data.outliers import Screened, screen_outliers
from ngbrain.inverse.data.quality import strain_snr_mask
from ngbrain.inverse.data.time_convention import check_passive
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.elastography.invert_3d import MAX_ITERATIONS
from ngbrain.inverse.elastography.invert_slices import moving_axis
from ngbrain.inverse.elastography.result import Inversion
from ngbrain.inverse.elastography.usability import torn_patches
from ngbrain.inverse.optimise.result import Iteration
from ngbrain.inverse.problem.discretisation import Discretisation, discretise, original_discretisation
from ngbrain.inverse.subzones.invert import invert_by_subzones
from ngbrain.inverse.uncertainty.credible_maps import count_hessian_products, estimate_seconds, uncertainty
from ngbrain.io import write_json
from ngbrain.io.versions import versions
from ngbrain.io.waves import WaveData, read_waves
from ngbrain.io.waves.grid import hull
from ngbrain.parallel import AnyExecutor, Callback, open_executor
from ngbrain.progress import LOG, Progress, terminal
from ngbrain.report.pages import parameters
from ngbrain.solvers.device import Device
from ngbrain.threads import threads
from ngbrain.workflows.bids import check_subject
from ngbrain.workflows.property_maps import finite, write_inversion

DISCRETISATIONS: dict[str, Callable[[WaveData], Discretisation]] = {"data": original_discretisation, "fe": discretise}
STARTS: dict[str, tuple[float, ...] | None] = {
    "auto": None,
    "waves": (),
    "all": (1.0,),
    "many": (0.5, 0.7, 1.0, 1.4, 2.0),
}
"""Levels of uniform initial guesses, see `invert`."""
IN_ZONES = {
    "--model-error": (None, 0.0),
    "--discretisation": (None, "fe"),
    "--regulariser": ("smooth", "auto"),
    "--weight": ("evidence",),
    "--start": (None,),
    "--starts": ("auto",),
    "--unknowns": ("moduli",),
    "--misfit": ("squares",),
    "--bars": (False,),
    "--device": ("cpu",),
}
"""Values of other options that inversion by subzones accepts."""
SEED = 0
"""Seed of the probes that estimate the degrees of freedom."""


def run(arguments: argparse.Namespace) -> int:
    """Read, invert, write, report, print."""
    started, rounds = time.monotonic(), list[Iteration]()
    data = _read_data(arguments)
    folder: Path = arguments.output
    with Progress(terminal(arguments.quiet)) as line, threads(arguments.threads), file_context(arguments.data):

        def callback(iteration: Iteration) -> None:
            rounds.append(iteration)
            line.callback(f"iteration {len(rounds)}, {iteration}")

        line.callback("reading")
        data, notes, patches = _select_points(data, arguments)
        try:
            with open_executor(arguments.executor or arguments.threads) as executor:
                inversion = (_invert_zones if arguments.subzones else _invert_whole)(
                    data, arguments, callback, executor
                )
            bars = None
            if arguments.bars:
                about = f"error bars: about {estimate_seconds(inversion):.0f} s, {count_hessian_products(inversion)} products"
                line.callback(about)
                LOG.info(about)
                bars = uncertainty(inversion, prior="best" if arguments.regulariser == "auto" else "own")
                inversion = bars.found
        except SolverError:
            write_json(folder / "rounds.json", finite([asdict(each) for each in rounds]))
            raise
    inversion.checks |= torn_patches(patches)
    inversion.warnings += notes + (bars.notes if bars else [])
    result = write_inversion(
        folder,
        inversion,
        bars,
        subject=arguments.bids,
        verb="invert",
        source=arguments.data.name,
        versions=versions(),
        seed=SEED,
        threads=arguments.threads,
        device=arguments.device,
        time_s=time.monotonic() - started,
    )
    from ngbrain.report.pages import elastography

    arrays = inversion.arrays() | (bars.arrays() if bars else {})
    report = elastography.build(folder / "report.html", result, inversion.data, arrays)
    notes = [f"note: {text}" for text in result["warnings"]]
    conclude(arguments.quiet, [*summary(result), f"report: {report}"], notes)
    if not inversion.usable:
        LOG.warning("do not use these maps: %s", "; ".join(inversion.reasons))
        return EXIT_SOLVER
    return 0


def _select_points(data: WaveData, arguments: argparse.Namespace) -> Screened:
    """The data without the parts to be left out, and notes on these."""
    notes, patches = list[str](), 0.0
    check_passive(data)
    if arguments.drop_outliers and moving_axis(data) is None:  # slices are screened one by one
        data, notes, patches = screen_outliers(data)
    if arguments.oss_snr is not None:
        strained = strain_snr_mask(data, arguments.noise, arguments.oss_snr)
        words = (
            f"{int((data.mask & ~strained).sum())} of {int(data.mask.sum())} points are left out, outside the part with"
        )
        notes.append(f"{words} octahedral shear strains of at least {arguments.oss_snr:g} times the noise (OSS-SNR)")
        data = replace(data, mask=strained, dirichlet=hull(data.points, data.grid, strained))
    return Screened(data, notes, patches)


def _invert_whole(
    data: WaveData, arguments: argparse.Namespace, callback: Callback, executor: AnyExecutor
) -> Inversion:
    chosen = arguments.discretisation
    started = surrogate_start(data) if arguments.start else None
    inversion = invert(
        data,
        DISCRETISATIONS[chosen](data) if chosen else None,
        noise=arguments.noise,
        model_error=arguments.model_error,
        regulariser=arguments.regulariser,
        weight=arguments.weight,
        levels=STARTS[arguments.starts],
        labelled=arguments.by_label,
        unknowns=arguments.unknowns,
        misfit=arguments.misfit,
        start=started.maps if started else None,
        max_iterations=arguments.rounds,
        drop_outliers=arguments.drop_outliers and moving_axis(data) is not None,  # else done before
        device=arguments.device,
        callback=callback,
        executor=executor,
    )
    inversion.warnings += started.notes if started else []
    return inversion


def _invert_zones(
    data: WaveData, arguments: argparse.Namespace, callback: Callback, executor: AnyExecutor
) -> Inversion:
    kept = arguments.output / "zones"
    inversion = invert_by_subzones(
        data,
        noise=arguments.noise,
        executor=executor,
        labelled=arguments.by_label,
        max_iterations=arguments.rounds or MAX_ITERATIONS,
        checkpoint=kept,
        callback=callback,
    )
    shutil.rmtree(kept)
    return inversion


def _read_data(arguments: argparse.Namespace) -> WaveData:
    """The data; errors are reported before the work begins."""
    for package in ("matplotlib", "jinja2"):
        require(package, "report")
    for option, level in (("--noise", arguments.noise), ("--model-error", arguments.model_error)):
        if level is not None and not 0 <= level <= 10:
            raise InputError(option, level, "relative, from 0 to 10 (0.02: two per cent)")
    if arguments.rounds is not None and arguments.rounds < 1:
        raise InputError("--rounds", arguments.rounds, "at least 1")
    if arguments.oss_snr is not None and not 0 < arguments.oss_snr < np.inf:
        raise InputError("--oss-snr", arguments.oss_snr, "a positive number, such as 3")
    if arguments.start and arguments.starts != "auto":
        raise InputError("--starts", arguments.starts, "left out with --start, which is the only initial guess then")
    if arguments.start:
        runtime_version()
    if arguments.subzones:
        for option, wanted in IN_ZONES.items():
            given = getattr(arguments, option.removeprefix("--").replace("-", "_"))
            if given not in wanted:
                raise InputError(
                    option, given, f"{wanted[0] or 'left out'} with --subzones, which accept no other value"
                )
    Device.from_name(arguments.device)
    data = read_waves(arguments.data)
    data = data.conjugate() if arguments.conjugate else data
    if arguments.bids:
        check_subject(arguments.bids, data)
    if arguments.bars and moving_axis(data) is not None:
        raise InputError("--bars", "given", "one slice in a file of its own: slabs are inverted slice by slice")
    if data.affine is not None:
        require("nibabel", "mri")
    return data


def summary(result: dict[str, Any]) -> list[str]:
    """Lines of the summary: parameters, initial guesses, assumptions and findings."""
    reasons = result.get("reasons")
    lines = [f"Do not use: {'; '.join(reasons)}", ""] if reasons else []
    ends = parameters.intervals(result)
    head = f"{'parameter':<34}{'median':>9}{'IQR':>9}{'error':>12}"
    lines.append(f"{head}   mean (95 % interval)" if ends else head)
    for i, row in enumerate(parameters.parameters(result)):
        median, iqr, error = (text for text, _ in row.cells)
        line = f"{f'{row.name} {row.unit}':<34}{median:>9}{iqr:>9}{error:>12}"
        lines.append(f"{line}   {ends[i]}" if ends else line)
    symbols = [parameters.PARAMETERS[name].symbol for name in result["answers"]]
    heads = [*(f"{symbol} error" for symbol in symbols), "misfit/exp", "J", "iterations", "converged", "CPU s"]
    lines += ["", f"{'start':<34}" + "".join(f"{head:>11}" for head in heads)]
    for row in parameters.starts(result):
        name = f"{row.name} *" if row.unit else row.name
        lines.append(f"{name:<34}" + "".join(f"{text:>11}" for text, _ in row.cells))
    lines += ["* selected", ""]
    lines += [f"{name}: {text}" for name, text in parameters.facts(result)]
    return [
        *lines,
        f"Time: {result['time_s']:.1f} s on {result['threads']} thread{'s' if result['threads'] > 1 else ''}",
    ]
