"""The verb `mesh`: a scan or a map of labels to a volume mesh."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from ngbrain.errors import InputError, require
from ngbrain.mesh.grading import Graded
from ngbrain.mesh.opening import Opening
from ngbrain.mesh.routes import ROUTES
from ngbrain.mesh.subject import Subject, write_subject

PLACE = "X,Y,Z"
CUT = ("opening", "width", "craniotomy", "approach", "across")
"""Options of the cleft."""


def add_mesh(verbs: Any) -> argparse.ArgumentParser:
    """Add the verb to a parser's verbs."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        "mesh",
        help="a volume mesh of a scan or of a map of labels",
        epilog="A place is X,Y,Z in mm as the file places it, voxel:I,J,K of the file counted from 0, or a landmark's name.",
    )
    parser.add_argument("image", metavar="IMAGE", help="a T1 scan, or with --labels a map of labels: NIfTI or MGH")
    parser.add_argument("--labels", action="store_true", help="IMAGE is a map of labels")
    parser.add_argument(
        "--names",
        type=_names,
        default=(None, {}),
        metavar="N=NAME,…",
        help="what labels are called, or freesurfer, spm, ngbrain, with N=NAME,… of one's own behind it",
    )
    parser.add_argument(
        "--structures", action="store_true", help="split tissues: left, right, cerebellum, stem, deep grey, callosum"
    )
    parser.add_argument("--atlas", metavar="LABELS", help="regions of an atlas of your own, laid into the scan, with")
    parser.add_argument("--template", metavar="T1", help="what it was drawn on, with its skull or without")
    parser.add_argument("--route", default="hull", choices=ROUTES, help="how (hull)")
    parser.add_argument("--size", type=_length, metavar="MM", help="element size, away from the site if there is one")
    parser.add_argument("--site", metavar=PLACE, help="a place to be finer around")
    parser.add_argument("--near", type=_length, default=2e-3, metavar="MM", help="element size at the site or cut (2)")
    parser.add_argument(
        "--radius", type=_length, metavar="MM", help="around it that is so fine (hull 17, lattice 10.5, conforming 20)"
    )
    parser.add_argument("--curve", action="store_true", help="curve the interfaces of tissues, with second order")
    parser.add_argument(
        "--landmark", action="append", default=[], metavar="NAME=PLACE", help="name a place; as often as needed"
    )
    cut = parser.add_argument_group("a cut", "a cleft with plane walls under a craniotomy")
    cut.add_argument("--cut", metavar=PLACE, help="the centre of its floor, a place in tissue")
    cut.add_argument("--opening", type=_length, metavar="MM", help="between its walls (4)")
    cut.add_argument("--width", type=_length, metavar="MM", help="along its walls (12)")
    cut.add_argument("--craniotomy", type=_length, metavar="MM", help="diameter of the hole in the skull (40)")
    cut.add_argument("--approach", type=_direction, metavar=PLACE, help="direction outwards (the shortest way)")
    cut.add_argument("--across", type=_direction, metavar=PLACE, help="direction from wall to wall (left to right)")
    parser.set_defaults(verb=run)
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Read, mesh, write, report, print."""
    for package in ("matplotlib", "jinja2"):
        require(package, "report")
    shape = {name: getattr(arguments, name) for name in CUT if getattr(arguments, name) is not None}
    if shape and not arguments.cut:
        raise InputError(f"--{min(shape)}", "given without --cut", "--cut with the place of the cleft's floor")
    if arguments.cut and arguments.site:
        raise InputError("--site", "given with --cut", "one of them: a mesh is finest at its cut")
    if arguments.labels and arguments.structures:
        raise InputError("--structures", "given with --labels", "a T1 scan to find them in, or --labels without it")
    if (arguments.atlas is None) != (arguments.template is None):
        given, lacking = ("--template", "--atlas") if arguments.atlas is None else ("--atlas", "--template")
        raise InputError(given, f"given without {lacking}", "both: an atlas and the T1 that it was drawn on")
    if arguments.atlas and (arguments.labels or arguments.structures):
        found = f"given with --{'labels' if arguments.labels else 'structures'}"
        raise InputError("--atlas", found, "one of them: an atlas says what regions there are")
    if arguments.atlas:
        subject = Subject.of_atlas(arguments.image, arguments.atlas, arguments.template, *arguments.names)
    elif arguments.labels:
        subject = Subject.of_labels(arguments.image, *arguments.names)
    else:
        subject = (Subject.of_structures if arguments.structures else Subject.of_scan)(arguments.image)
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
    size = Graded(coarse if site is None and floor is None else min(arguments.near, coarse), coarse, site, radius)
    try:
        opening = Opening(floor, **shape) if floor else None
        result, mesh = write_subject(subject, arguments.output, arguments.route, size, arguments.curve, opening)
    except InputError as wrong:
        name = wrong.field.removeprefix("cleft.").removesuffix("_mm")
        if name == wrong.field:
            raise
        option = "--cut" if name == "target" else f"--{name}"
        raise InputError(option, wrong.value, wrong.wanted, wrong.file) from wrong
    from ngbrain.report import anatomy

    shown = 1e-3 * np.array(result["shown_mm"])
    anatomy.build(arguments.output.with_name("report.html"), result, mesh, subject.labels, subject.t1, shown)
    if not arguments.quiet:
        for name, region in result["regions"].items():
            print(f"{name:<20}{region['volume_ml']:>9.1f} ml, labels {region['label_volume_ml']:.1f} ml")
        quality = result["quality"]
        print(f"{quality['n_tets']} tetrahedra, smallest dihedral angle {quality['min_dihedral_deg']:.1f}°")
        if snaps := result.get("snaps"):
            print(f"{snaps['snapped']} points snapped onto interfaces, {snaps['rejected']} snaps rejected")
        for name, error in result["checks"]["regions_off"].items():
            print(
                f"{name} is off by {error:+.0%} in volume: too thin for such elements, or too close to what is around"
            )
        if off := result.get("curved"):
            print(f"interfaces off by {off['mean_mm_before']:.3f} mm, curved by {off['mean_mm_after']:.3f} mm")


def _length(text: str) -> float:
    return 1e-3 * float(text)


def _direction(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not three numbers with commas") from error
    return x, y, z


def _names(text: str) -> tuple[str | dict[int, str] | None, dict[int, str]]:
    """A scheme or names, and names besides."""
    first, *rest = text.split(",")
    given = rest if "=" not in first else [first, *rest]
    try:
        named = {int(number): name.strip() for number, name in (part.split("=") for part in given)}
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not number=name,number=name,…") from error
    if "" in named.values():
        raise argparse.ArgumentTypeError(f"{text!r} has an empty name")
    return (named, {}) if "=" in first else (first, named)
