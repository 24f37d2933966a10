"""The verb `mesh`: a volume mesh from a scan, labels, surfaces or another mesh."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.cli.words import conclude
from ngbrain.errors import InputError, require
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.io.foreign import is_mesh
from ngbrain.io.surfacefile import is_surface
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.head_mesh import HeadMesh
from ngbrain.mesh.imported import write_imported
from ngbrain.mesh.routes.craniotomy import Opening
from ngbrain.mesh.routes.registry import ROUTES
from ngbrain.progress import Progress, terminal
from ngbrain.workflows.mesh_head import write_subject
from ngbrain.workflows.subject import Subject

SHOWN = 3
"""Number of changes of a region that are printed; all are in result.json."""
EXIT_UNUSABLE = 3
ROUTE, UNIT = "hull", "mm"
LABELS_OF = ("labels", "names", "structures", "atlas")
"""Options on an image's labels."""
CUT = ("opening", "width", "craniotomy", "approach", "across")
"""Options of the cleft."""


def run(arguments: argparse.Namespace) -> int:
    """Read, mesh, write, report, print; returns the exit status, 3 if too much of the labels had to be changed."""
    with Progress(terminal(arguments.quiet), text="reading and labelling") as line:
        result = _mesh_input(arguments, line.callback)
    conclude(arguments.quiet, summary(result), cautions(result))
    return EXIT_UNUSABLE if result["checks"]["changed_ml"] else 0


def _mesh_input(arguments: argparse.Namespace, callback: Callable[[str], None]) -> dict[str, Any]:
    for package in ("matplotlib", "jinja2"):
        require(package, "report")
    shape = {name: getattr(arguments, name) for name in CUT if getattr(arguments, name) is not None}
    if shape and not arguments.cut:
        raise InputError(f"--{min(shape)}", "given without --cut", "--cut with the place of the cleft's floor")
    if arguments.cut and arguments.site:
        raise InputError("--site", "given with --cut", "one of them: a mesh is finest at its cut")
    if arguments.labels and arguments.structures:
        raise InputError("--structures", "given with --labels", "a T1 scan to find them in, or --labels without it")
    if (arguments.atlas is None) != (arguments.atlas_t1 is None):
        given, lacking = ("--atlas-t1", "--atlas") if arguments.atlas is None else ("--atlas", "--atlas-t1")
        raise InputError(given, f"given without {lacking}", "both: an atlas and the T1 that it was drawn on")
    if arguments.atlas and (arguments.labels or arguments.structures):
        found = f"given with --{'labels' if arguments.labels else 'structures'}"
        raise InputError("--atlas", found, "one of them: an atlas says what regions there are")
    if is_mesh(arguments.images[0]):
        return _convert_mesh(arguments, callback)
    subject = _subject(arguments)
    arguments.route = arguments.route or ROUTE
    for each in arguments.landmark:
        name, _, where = each.partition("=")
        if not (name and where):
            raise InputError("--landmark", repr(each), "NAME=X,Y,Z in mm, or NAME=voxel:I,J,K")
        subject.named[name] = subject.place(where, "--landmark")
    site, floor = (
        subject.place(text, option) if text else None
        for option, text in (("--site", arguments.site), ("--cut", arguments.cut))
    )
    coarse = ROUTES[arguments.route].size if arguments.size is None else arguments.size
    radius = ROUTES[arguments.route].radius if arguments.radius is None else arguments.radius
    size = RadialSizeField(
        coarse if site is None and floor is None else min(arguments.near, coarse), coarse, site, radius
    )
    callback("meshing")
    try:
        opening = Opening(floor, **shape) if floor else None
        made = write_subject(
            subject,
            arguments.output,
            arguments.route,
            size,
            arguments.curve,
            opening,
            arguments.surfaces,
            arguments.mesh_unit,
        )
    except InputError as wrong:
        name = wrong.field.removeprefix("cleft.").removesuffix("_mm")
        if name == wrong.field:
            raise
        option = "--cut" if name == "target" else f"--{name}"
        raise InputError(option, wrong.value, wrong.wanted, wrong.file) from wrong
    return _write_report(arguments, made, subject.labels, subject.t1, callback)


def _convert_mesh(arguments: argparse.Namespace, callback: Callable[[str], None]) -> dict[str, Any]:
    """A mesh of another program; options that would change it or need labels are refused."""
    _refuse_options(
        arguments, "a mesh", (*LABELS_OF, "route", "size", "site", "cut", "curve", "surfaces", "landmark", "radius")
    )
    callback("reading")
    made = write_imported(arguments.images[0], arguments.output, arguments.unit, arguments.mesh_unit)
    return _write_report(arguments, made, None, None, callback)


def _subject(arguments: argparse.Namespace) -> Subject:
    """The subject, by the type of the files."""
    parts = [_named_surface(text) for text in arguments.images]
    flat = [is_surface(path) for _, path in parts]
    if any(flat):
        if not all(flat):
            raise InputError("IMAGE", str(parts[flat.index(False)][1]), "a closed surface, as the others are")
        _refuse_options(arguments, "surfaces", LABELS_OF, several=True)
        return Subject.from_surfaces(parts, arguments.unit or UNIT, not arguments.no_fill)
    _refuse_options(arguments, "an image", ("unit",))
    image = arguments.images[0]
    if arguments.atlas:
        return Subject.from_atlas(image, arguments.atlas, arguments.atlas_t1, *arguments.names)
    if arguments.labels:
        names, others = arguments.names
        return Subject.from_labels(image, names, others, not arguments.no_fill)
    return (Subject.from_structures if arguments.structures else Subject.from_scan)(image)


def _refuse_options(arguments: argparse.Namespace, what: str, options: tuple[str, ...], several: bool = False) -> None:
    """`InputError` for options that do not apply to the input, and for more than one file unless `several`."""
    for name in options:
        if getattr(arguments, name) not in (None, False, [], (None, {})):
            raise InputError(f"--{name}", f"given with {what}", "left out: it does not apply")
    if len(arguments.images) > 1 and not several:
        raise InputError("IMAGE", f"{len(arguments.images)} files", "one file, or closed surfaces only")


def _named_surface(text: str) -> tuple[str, Path]:
    """A surface's name and file: the given name, or one derived from FreeSurfer's or the file's name."""
    name, equals, file = text.partition("=")
    if equals and name and not Path(text).exists():
        return name, Path(file)
    path = Path(text)
    words = re.split(r"[._-]", path.name.lower())
    known = {"pial": "grey", "white": "white", "smoothwm": "white"}
    return next((known[word] for word in words if word in known), path.name.split(".")[0]), path


def _write_report(
    arguments: argparse.Namespace,
    made: HeadMesh,
    labels: LabelMap | None,
    t1: Volume | None,
    callback: Callable[[str], None],
) -> dict[str, Any]:
    callback("report")
    from ngbrain.report.pages import anatomy

    shown = 1e-3 * np.array(made["shown_mm"])
    anatomy.build(arguments.output.with_name("report.html"), made.data, made.elements, labels, t1, shown)
    return made.data


def summary(result: dict[str, Any]) -> list[str]:
    """Lines of the summary: changes of the labels, volumes, elements."""
    lines = list(result["notes"])
    lines += [
        f"{name:<20}{region['volume_ml']:>9.1f} ml"
        + (f", labels {region['label_volume_ml']:.1f} ml" if "label_volume_ml" in region else "")
        for name, region in result["regions"].items()
    ]
    quality = result["quality"]
    lines.append(f"{quality['n_tets']} tetrahedra, smallest dihedral angle {quality['min_dihedral_deg']:.1f}°")
    if "grey_white_contrast" in result:
        lines.append(
            f"grey and white matter differ by {result['grey_white_contrast']:.1f} times the spread of one tissue"
        )
    if snaps := result.get("snaps"):
        lines.append(f"{snaps['snapped']} points snapped onto interfaces, {snaps['rejected']} snaps rejected")
    if off := result.get("curved"):
        lines.append(f"interfaces off by {off['mean_mm_before']:.3f} mm, curved by {off['mean_mm_after']:.3f} mm")
    if found := result.get("surfaces"):
        thick = found["thickness_mm"]
        lines.append(
            f"cortex {thick['mean']:.2f} mm thick (quartiles {thick['p25']:.2f} to {thick['p75']:.2f}), by {found['by']}; white "
            f"surface {found['white']['area_cm2']:.0f} cm², pial {found['pial']['area_cm2']:.0f} cm²"
        )
    few = {repair["region"] for repair in result["repairs"]} - set(result["checks"]["changed_ml"])
    return lines + [_describe_changes(result, name) for name in sorted(few)]


def cautions(result: dict[str, Any]) -> list[str]:
    """Regions that the mesh represents poorly, and those that were changed too much."""
    changed = [
        f"do not use without checking: {_describe_changes(result, name)}" for name in result["checks"]["changed_ml"]
    ]
    if crossed := result.get("surfaces", {}).get("crossings"):
        changed.append(f"the white and pial surfaces cross at {crossed} pairs of triangles")
    return changed + [
        f"the volume of {name} is off by {error:+.0%}: too thin for such elements, or too close to its neighbours"
        for name, error in result["checks"]["volume_errors"].items()
    ]


def _describe_changes(result: dict[str, Any], name: str) -> str:
    """Changes of a region, and the locations of the largest."""
    places = sorted((place for place in result["repairs"] if place["region"] == name), key=lambda place: -place["ml"])
    told = [
        f"{place['ml']:.2g} ml {place['kind']} at ({', '.join(f'{c:.0f}' for c in place['at_mm'])}) mm"
        for place in places[:SHOWN]
    ]
    told += [f"{len(places) - SHOWN} more in result.json"] if len(places) > SHOWN else []
    return f"{name} differs from the labels by {sum(place['ml'] for place in places):.2g} ml: {'; '.join(told)}"
