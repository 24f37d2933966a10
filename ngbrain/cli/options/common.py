"""The parser of the command line, and the options of its verbs; nothing that would delay `--help` is imported."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any, NoReturn

from ngbrain import __version__
from ngbrain.cli.options import types
from ngbrain.cli.options.cohort import add_cohort
from ngbrain.cli.options.simulate import add_laws, add_simulate

PLACE = "X,Y,Z"
# Names that the library has in tables, which take a second to import; a test holds these to them.
ROUTES = ("hull", "lattice", "conforming")
SCHEMES = ("freesurfer", "synthseg", "muse", "spm", "cat", "fast", "ngbrain")
UNITS = ("m", "cm", "mm", "um")
DISCRETISATIONS = ("data", "fe")
STARTS = ("auto", "waves", "all", "many")
PRIORS = ("smooth", "edges", "steps", "matern")
WEIGHTINGS = ("evidence", "discrepancy", "l-curve")
UNKNOWNS = ("moduli", "polar")
MISFITS = ("squares", "huber")
DEVICES = ("auto", "cpu", "cuda", "ngsolve")
SPREAD = 3.0


def parser() -> argparse.ArgumentParser:
    """The parser of the command; `verb` is the verb or None."""
    return _parsers()[0]


def parsers() -> dict[str, argparse.ArgumentParser]:
    """The parsers of the verbs, by name."""
    return _parsers()[1]


def _parsers() -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    command = _Parser(prog="ngbrain", description="In silico brain surgery.")
    command.add_argument("--version", action="version", version=f"ngbrain {__version__}")
    verbs = command.add_subparsers(dest="verb", metavar="VERB")
    demo, scene, mesh = _demo(verbs), add_simulate(verbs), _mesh(verbs)
    invert, predict, stiff = _invert(verbs), _predict(verbs), _calibrate(verbs)
    many = add_cohort(verbs)
    _materials(verbs)
    _data(verbs)
    folders = (
        (demo, "demo"), (scene, "simulated"), (mesh, "head.vtkhdf"), (invert, "inverted"), (predict, "predicted"),
        (stiff, "calibrated"), (many, "cohort"),
    )  # fmt: skip
    assembling = invert, predict, stiff
    for verb, folder in folders:
        kind = "FILE" if verb is mesh else "DIR"
        verb.add_argument(
            "-o", dest="output", type=Path, default=Path(folder), metavar=kind, help=f"where results go ({folder})"
        )
        if verb in (demo, scene):
            verb.add_argument(
                "--no-checks",
                dest="checks",
                action="store_false",
                help="protocols alone: without the error estimates of mesh, order and time steps",
            )
        if verb in (demo, scene, stiff):
            verb.add_argument("--resume", action="store_true", help="go on with a run that was stopped")
        if verb is not mesh:
            verb.add_argument(
                "--threads",
                type=types.threads,
                default=1 if verb in (*assembling, many) else os.cpu_count() or 1,
                metavar="N",
                help="for assembly (1)" if verb in assembling else "processes side by side",
            )
        if verb in (demo, scene, invert, many):
            add_executor(verb)
        replace = "--overwrite" if verb is stiff else "--force"  # whose --force is a table of forces
        verb.add_argument(replace, dest="overwrite", action="store_true", help="replace results that are there already")
        verb.add_argument("-q", dest="quiet", action="store_true", help="no progress and no summary; warnings stay")
    return command, dict(verbs.choices)


def add_executor(verb: argparse.ArgumentParser) -> None:
    """Add `--executor` to a verb with independent tasks."""
    verb.add_argument(
        "--executor",
        metavar="WHO",
        help="who computes what is independent, in place of --threads: N processes, dask:ADDRESS, mpi[:N] or slurm[:KEY=VALUE,...]",
    )


class _Parser(argparse.ArgumentParser):
    """Reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {' '.join(message.split())}; see {self.prog} --help\n")


def _demo(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser(
        "demo", help="a retraction on the demonstration head, three ways"
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--head", choices=["mni152", "idealised"], default="mni152", help="which head (mni152)")
    which.add_argument(
        "--image", metavar="FILE", help="a T1 scan (NIfTI), with skull or without, to operate on instead"
    )
    parser.add_argument("--fast", action="store_true", help="a coarse mesh and shorter protocols")
    return parser


def _mesh(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser(
        "mesh",
        help="a volume mesh of a scan, a map of labels or closed surfaces, or from another program's",
        epilog="A place is X,Y,Z in mm as the file places it, voxel:I,J,K of the file counted from 0, or a landmark's name.",
    )
    parser.add_argument(
        "images",
        metavar="IMAGE",
        nargs="+",
        help="a T1 scan (NIfTI, MGH, a folder of DICOM files or one of them); with --labels a map of labels; closed surfaces "
        "[NAME=]FILE, the outer ones first (STL, PLY, OBJ, OFF, GIfTI, FreeSurfer's lh.pial); or a mesh of tetrahedra (Gmsh, "
        "Abaqus, VTK, FEBio, Netgen, Medit, XDMF)",
    )
    parser.add_argument("--labels", action="store_true", help="IMAGE is a map of labels")
    parser.add_argument(
        "--names",
        type=types.names,
        default=(None, {}),
        metavar="N=NAME,…",
        help=f"what labels are called, or one of {', '.join(SCHEMES)}, with N=NAME,… of one's own behind it",
    )
    parser.add_argument("--unit", choices=UNITS, help="of lengths in surfaces and meshes, which do not say it (mm)")
    parser.add_argument("--no-fill", action="store_true", help="leave sulci that have no label empty")
    parser.add_argument(
        "--structures", action="store_true", help="split tissues: left, right, cerebellum, stem, deep grey, callosum"
    )
    parser.add_argument(
        "--atlas", type=Path, metavar="LABELS", help="regions of an atlas of your own, laid into the scan, with"
    )
    parser.add_argument("--template", type=Path, metavar="T1", help="what it was drawn on, with its skull or without")
    parser.add_argument("--route", choices=ROUTES, help="how (hull)")
    parser.add_argument(
        "--size", type=types.length, metavar="MM", help="element size, away from the site if there is one"
    )
    parser.add_argument("--site", metavar=PLACE, help="a place to be finer around")
    parser.add_argument(
        "--near", type=types.length, default=2e-3, metavar="MM", help="element size at the site or cut (2)"
    )
    parser.add_argument(
        "--radius",
        type=types.length,
        metavar="MM",
        help="around it that is so fine (hull 17, lattice 10.5, conforming 20)",
    )
    parser.add_argument(
        "--surfaces", action="store_true", help="white and pial surface and the cortex's thickness too, as GIfTI"
    )
    parser.add_argument("--curve", action="store_true", help="curve the interfaces of tissues, with second order")
    parser.add_argument(
        "--landmark", action="append", default=[], metavar="NAME=PLACE", help="name a place; as often as needed"
    )
    cut = parser.add_argument_group("a cut", "a cleft with plane walls under a craniotomy")
    cut.add_argument("--cut", metavar=PLACE, help="the centre of its floor, a place in tissue")
    cut.add_argument("--opening", type=types.length, metavar="MM", help="between its walls (4)")
    cut.add_argument("--width", type=types.length, metavar="MM", help="along its walls (12)")
    cut.add_argument("--craniotomy", type=types.length, metavar="MM", help="diameter of the hole in the skull (40)")
    cut.add_argument("--approach", type=types.direction, metavar=PLACE, help="direction outwards (the shortest way)")
    cut.add_argument(
        "--across", type=types.direction, metavar=PLACE, help="direction from wall to wall (left to right)"
    )
    return parser


class _Sidecar(argparse.Action):
    """Print a sidecar of wave data."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from ngbrain.io.waves.nifti import TEMPLATE

        print(TEMPLATE, end="")
        parser.exit()


def _add_reading(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--template", action=_Sidecar, nargs=0, help="print a NIfTI sidecar to start from, and stop")
    parser.add_argument(
        "--conjugate",
        action="store_true",
        help="DATA is in the time convention e^{-iωt}, or its phase images are in reverse order: take the complex conjugate",
    )


def _invert(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser("invert", help="property maps from wave data")
    parser.add_argument("data", type=Path, metavar="DATA", help="wave data: .npz, .h5, .mat or NIfTI with its sidecar")
    _add_reading(parser)
    parser.add_argument(
        "--noise", type=float, metavar="SIGMA", help="relative to each component's rms (what DATA says, or found)"
    )
    parser.add_argument(
        "--model-error",
        type=float,
        metavar="SIGMA",
        help="what the model cannot fit, likewise (0; ultrasound at rest: it is said)",
    )
    parser.add_argument(
        "--discretisation",
        choices=DISCRETISATIONS,
        help="the data's own elements, or ours (the data's, if it has some)",
    )
    parser.add_argument(
        "--regulariser",
        choices=("auto", *PRIORS),
        default="auto",
        help="auto: smooth or edges, by cross-validation; steps for ultrasound at rest",
    )
    parser.add_argument(
        "--weight",
        choices=WEIGHTINGS,
        default="evidence",
        help="how the regulariser's weight is found (evidence)",
    )
    parser.add_argument(
        "--starts",
        choices=STARTS,
        default="auto",
        help="measured waves alone, uniform fields too (all), or uniform fields of several levels (many); auto: all in the plane, "
        "waves in space",
    )
    parser.add_argument(
        "--start",
        choices=("surrogate",),
        help="with measured waves, start from the maps of the trained operator (see `predict`) and nowhere else; in the plane",
    )
    parser.add_argument(
        "--rounds",
        type=int,
        metavar="N",
        help="iterations down from a start at most, of a zone likewise; a few of a large body are near the end already (96 in the "
        "plane, 16 in space)",
    )
    parser.add_argument(
        "--unknowns",
        choices=UNKNOWNS,
        default="moduli",
        help="what is smooth: storage and loss (moduli), or magnitude and phase (polar)",
    )
    parser.add_argument(
        "--misfit",
        choices=MISFITS,
        default="squares",
        help="squares, or huber for what --drop-outliers misses (squares)",
    )
    parser.add_argument(
        "--drop-outliers",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="leave out displacements that are far off a smooth field (yes)",
    )
    parser.add_argument(
        "--oss-snr",
        type=float,
        metavar="LEAST",
        help="leave out what is around the part whose octahedral shear strain is at least so many times (3, say) its noise in "
        "some load",
    )
    parser.add_argument(
        "--by-label",
        action="store_true",
        help="fields of their own for each label of DATA, which jump where labels meet",
    )
    parser.add_argument(
        "--bars",
        action="store_true",
        help="error bars too: credible intervals at every point, of the mean and of labels' means, under the prior that fits the "
        "data best; in the plane it then takes up to three times as long",
    )
    parser.add_argument(
        "--subzones",
        action="store_true",
        help="data in space in overlapping zones, --threads of them at a time, or on an --executor; a stopped run goes on",
    )
    parser.add_argument(
        "--device",
        choices=DEVICES,
        default="cpu",
        help="where waves are factorised and solved for: cuda is a GPU of NVIDIA's, by cuDSS; ngsolve solves on a GPU with "
        "factors of the processor; auto is the processor where no GPU was measured to be faster (cpu)",
    )
    return parser


def _predict(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser("predict", help="the same from a trained operator, at once")
    parser.add_argument("data", type=Path, metavar="DATA", help="wave data: .npz, .h5, .mat or NIfTI with its sidecar")
    _add_reading(parser)
    parser.add_argument(
        "--weights", type=Path, metavar="DIR", help="of `python -m ngbrain.surrogate` (those that are shipped)"
    )
    return parser


def _calibrate(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser(
        "calibrate", help="how stiff a patient's tissues are, from what a retraction was seen to do"
    )
    parser.add_argument("scene", type=Path, metavar="SCENE.toml", help="the operation that was seen, see `simulate`")
    parser.add_argument(
        "--landmarks",
        type=Path,
        metavar="FILE.csv",
        help="columns t_s, x_mm, y_mm, z_mm (where it was before), ux_mm, uy_mm, uz_mm (how far it has moved)",
    )
    parser.add_argument("--landmark-sd", type=float, metavar="MM", help="standard deviation of a displacement")
    parser.add_argument(
        "--force", type=Path, metavar="FILE.csv", help="columns t_s, force_N: of the blade, across the cleft"
    )
    parser.add_argument("--force-sd", type=float, metavar="N", help="standard deviation of a force")
    parser.add_argument(
        "--tissues", metavar="NAMES", help="which are looked for: regions of the scene, with commas (all)"
    )
    parser.add_argument("--protocol", metavar="NAME", help="which of the scene's was seen (the first)")
    add_laws(parser)
    parser.add_argument(
        "--spread",
        type=float,
        default=SPREAD,
        metavar="FACTOR",
        help=f"by what factor a tissue may well differ from the scene's constants ({SPREAD:g})",
    )
    parser.add_argument(
        "--no-finer",
        dest="finer",
        action="store_false",
        help="without the run on finer elements, whose error then stays in the factors and is missing in their intervals",
    )
    return parser


def _materials(verbs: Any) -> None:
    parser = verbs.add_parser(
        "materials",
        help="published constants of tissues, by the names that scenes take",
        description="List the published constants that scenes take by name, or say all about one.",
    )
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help="one of them, or a part of several names; all by default"
    )
    parser.add_argument(
        "--laws",
        nargs="?",
        const="",
        metavar="FILE.py",
        help="list the laws that scenes take by name, with their parameters; with those of a file of yours, which is run",
    )
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE.png",
        help="draw stress against stretch of what is listed, such as all of a region, over the stretches of the data (.pdf, .svg)",
    )
    parser.add_argument("--force", action="store_true", help="replace a picture that is there")
    parser.set_defaults(quiet=False, output=None)


def _data(verbs: Any) -> None:
    parser = verbs.add_parser("data", help="sample data: what there is, or some of it as files")
    parser.add_argument("names", nargs="*", metavar="NAME", help="what to write; without a name all are listed")
    parser.add_argument(
        "-o", dest="output", type=Path, default=Path(), metavar="DIR", help="where the files go (this folder)"
    )
    parser.add_argument("--force", action="store_true", help="replace files that are there")
    parser.add_argument("-q", dest="quiet", action="store_true", help="do not say what was written")
