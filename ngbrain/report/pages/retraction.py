"""The page of a retraction: pictures, findings, tables."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, require
from ngbrain.reading import read_json
from ngbrain.report import words
from ngbrain.report.pages import first_answers, tables
from ngbrain.report.pages.page import write_page
from ngbrain.report.pictures import animation, figures, slices, volume
from ngbrain.report.pictures.animation import Animation
from ngbrain.report.pictures.gltf import write_gltf
from ngbrain.report.pictures.panel import Panel, SurfaceLayer
from ngbrain.report.pictures.style import StrainScale, colour
from ngbrain.report.pictures.timeline import Run

__all__ = ["Report", "build"]

NEEDED = ("answers", "geometry")
SERIES = ("t_s", "opening_mm", "blade_mm", "pressure_mmHg")


def build(folder: str | os.PathLike[str]) -> Path:
    """Write `folder/report.html` from `folder/result.json` and the runs' `folder/PROTOCOL.vtkhdf` (see `Report`)."""
    return Report(folder).write()


class Report:
    """The page of a retraction, `report.html`; its pictures are drawn again only when there are other runs.

    The page contains its pictures and styles, so that it can be read, sent and printed by itself. Runs are in the folder, or in the
    folder within it that `result.json` names as `runs_in`.

    Parameters
    ----------
    folder : str or path-like
        Folder with `result.json` and the runs' `PROTOCOL.vtkhdf`.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is not installed.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        for package in ("matplotlib", "jinja2"):
            require(package, "report")
        self.folder = Path(folder)
        self._drawn: tuple[dict[str, bytes], Animation, str, float, Panel] | None = None
        self._runs: tuple[str, ...] = ()

    def write(self) -> Path:
        """Write the page from the current `result.json`.

        Beside it `scene.glb` (brain, tool and strain when strain is largest) and `PROTOCOL_series.csv` (every time series, with
        units in the names of its columns).

        Raises
        ------
        InputError
            `result.json` is missing, damaged or not from a retraction; or a run's file is.
        """
        folder, result = self.folder, _read(self.folder / "result.json")
        where, runs = folder / result.get("runs_in", ""), (result.get("runs_in", ""), *result["answers"])
        if self._drawn is None or runs != self._runs:
            self._drawn, self._runs = _pictures(where, result), runs
        pictures, film, shown, time, panel = self._drawn
        write_gltf(
            folder / "scene.glb", [each for each in panel.layers if isinstance(each, SurfaceLayer) and each.shown]
        )
        for name, answer in result["answers"].items():
            _write_series(folder / f"{name}_series.csv", answer["series"])
        answers, comparison = result["answers"], result.get("comparison") or {}
        status, band = result.get("check_status") or {}, result.get("material_uncertainty") or {}
        openings = [max(answer["series"]["blade_mm"]) for answer in answers.values()]
        return write_page(
            folder / "report.html",
            "retraction.html",
            pictures,
            result=result,
            film=film,
            panel=panel,
            shown=shown,
            time=words.duration(time),
            same_opening=len(openings) > 1 and max(openings) - min(openings) <= tables.EQUAL * max(openings),
            protocols={name: colour(name, answers) for name in answers},
            headlines=tables.headlines(answers),
            findings=tables.findings(answers, comparison.get("findings") or []),
            rows=tables.comparison(answers),
            regions=tables.regions(answers),
            risks=tables.risks(answers),
            response=result.get("dose_response") or {},
            missing=tables.missing(status),
            under_way=first_answers.under_way(result),
            first=first_answers.rows(result.get("first_answers") or {}),
            first_sentence=first_answers.sentence(result.get("first_answers") or {}),
            checks=tables.checks(result.get("checks") or {}, status),
            peak_error=tables.peak_error_sentence(result.get("error_budget") or {}),
            error_budget=tables.error_budget(result.get("error_budget") or {}),
            equal_work=comparison.get("dose_at_equal_working_time_mmHg_min") or {},
            band=band,
            laws=tables.band(band, status),
            geometry=result["geometry"],
            model=result.get("model") or {},
            volumes=slices.volumes(result.get("head") or {}, result.get("model") or {}),
        )


def _write_series(path: Path, series: Mapping[str, Any]) -> None:
    """Write the time series of a protocol that have a value at each time; an unknown value is left empty."""
    names = [name for name, values in series.items() if len(values) == len(series["t_s"])]
    rows = zip(*(series[name] for name in names), strict=True)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(["" if value is None else value for value in row] for row in rows)
    atomic_write(path, lambda part: part.write_text(text.getvalue(), encoding="utf-8"))


def _read(path: Path) -> dict[str, Any]:
    result = read_json(path, "result")
    missing = [key for key in NEEDED if not isinstance(result, dict) or not isinstance(result.get(key), dict)]
    if missing or not result["answers"]:
        raise InputError(missing[0] if missing else "answers", "missing", "the result of an operation", file=path)
    for protocol, answer in result["answers"].items():
        series = answer.get("series") if isinstance(answer, dict) else None
        if not isinstance(series, dict) or not all(series.get(key) for key in SERIES):
            raise InputError(f"answers.{protocol}.series", "incomplete", ", ".join(SERIES), file=path)
        if not isinstance(answer.get("mps_p99"), float):
            raise InputError(f"answers.{protocol}.mps_p99", answer.get("mps_p99"), "a strain", file=path)
    return result


def _pictures(folder: Path, result: dict[str, Any]) -> tuple[dict[str, bytes], Animation, str, float, Panel]:
    """Pictures by name, the animation, the protocol shown in 3-D (the first with the largest strain), its time (s), the panel."""
    answers = result["answers"]
    strain = {name: answer.get("mps_p95") or 0.0 for name, answer in answers.items()}
    shown = next(name for name in answers if strain[name] >= (1 - tables.EQUAL) * max(strain.values()))
    try:
        runs = {name: Run.read(folder, name, result["geometry"], answer) for name, answer in answers.items()}
        peak = runs[shown].peak()
    except (KeyError, TypeError) as error:
        raise InputError(
            "geometry", "incomplete", f"the result of an operation ({error})", folder / "result.json"
        ) from error
    image = slices.ScanImage.read(folder)
    scale = StrainScale.up_to(max(answer["mps_p99"] for answer in answers.values()))
    drawn = {
        "head": figures.head(peak, scale),
        "pressure": figures.pressure(answers),
        "slice": figures.strain_slice(peak, scale),
    }
    if len(runs) > 1:
        drawn["peaks"] = animation.peaks(runs, answers, scale)
    if image:
        drawn["slices"] = slices.slices(image, peak)
    return drawn, animation.animation(runs, answers, scale), shown, peak.time, volume.panel(peak, scale, image)
