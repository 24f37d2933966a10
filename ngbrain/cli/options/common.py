"""The parser of the command line, and the options of its verbs; nothing that would delay `--help` is imported."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from ngbrain import __version__
from ngbrain.cli.options import types
from ngbrain.cli.options.cohort import add_cohort
from ngbrain.cli.options.help_page import CommandParser, VerbParser, add_examples
from ngbrain.cli.options.print_text import PrintText, completion_script, law_template, sidecar_template, table_template
from ngbrain.cli.options.simulate import add_laws, add_simulate
from ngbrain.cli.options.twin import add_twin

PLACE = "X,Y,Z"
# Names in tables of the library, whose import would take a second; a test compares them.
ROUTES = ("hull", "lattice", "conforming")
SCHEMES = ("freesurfer", "synthseg", "muse", "spm", "cat", "fast", "ngbrain")
UNITS, MESH_UNITS = ("m", "cm", "mm", "um"), ("m", "mm")
DISCRETISATIONS = ("data", "fe")
STARTS = ("auto", "waves", "all", "many")
PRIORS = ("smooth", "edges", "steps", "matern")
WEIGHTINGS = ("evidence", "discrepancy", "l-curve")
UNKNOWNS = ("moduli", "polar")
MISFITS = ("squares", "huber")
DEVICES = ("auto", "cpu", "cuda", "ngsolve")
SPREAD = 3.0
SHELLS = ("bash", "zsh", "tcsh")
TABLES = ("landmarks", "force")


def parser() -> argparse.ArgumentParser:
    """The parser of the command; `verb` is the verb or None."""
    return _parsers()[0]


def parsers() -> dict[str, argparse.ArgumentParser]:
    """The parsers of the verbs, by name."""
    return _parsers()[1]


def _parsers() -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    command = CommandParser(
        prog="ngbrain",
        description="Brain surgery in silico: heads from scans, stiffness from waves, retractions with how far to believe them.",
        epilog="`ngbrain VERB --help` lists the options of a verb, with examples; `ngbrain data` writes files to try them on.",
    )
    command.add_argument(
        "--version", action="version", version=f"ngbrain {__version__}", help="print the version, and stop"
    )
    command.add_argument(
        "--print-completion",
        action=PrintText,
        of=completion_script,
        choices=SHELLS,
        metavar="SHELL",
        help=f"print what completes commands in a shell ({', '.join(SHELLS)}), and stop; needs the extra `completion`",
    )
    verbs = command.add_subparsers(dest="verb", metavar="VERB", parser_class=VerbParser)
    demo, scene, mesh = _demo(verbs), add_simulate(verbs), _mesh(verbs)
    invert, predict, stiff = _invert(verbs), _predict(verbs), _calibrate(verbs)
    compared, many = add_twin(verbs), add_cohort(verbs)
    _materials(verbs)
    _data(verbs)
    _doctor(verbs)
    folders = (
        (demo, "demo"), (scene, "simulated"), (mesh, "meshed"), (invert, "inverted"), (predict, "predicted"),
        (stiff, "calibrated"), (compared, "twin"), (many, "cohort"),
    )  # fmt: skip
    assembling = invert, predict, stiff
    for verb, folder in folders:
        file = "; DIR/NAME.msh, .vtu, .inp, … for another name and format than head.vtkhdf" if verb is mesh else ""
        place = f"folder of the results ({folder}){file}"
        verb.add_argument("-o", dest="output", type=Path, default=Path(folder), metavar="DIR", help=place)
        if verb in (demo, scene):
            verb.add_argument(
                "--no-checks",
                dest="checks",
                action="store_false",
                help="protocols only, without error estimates of mesh, order and time steps",
            )
            verb.add_argument(
                "--quick",
                action="store_true",
                help="first answers in a minute or two, coarse, with intervals; then the scene as described in the same report",
            )
        if verb in (demo, scene, stiff, compared):
            verb.add_argument("--resume", action="store_true", help="continue an interrupted run")
        if verb is not mesh:
            verb.add_argument(
                "--threads",
                type=types.threads,
                default=1 if verb in (*assembling, many) else os.cpu_count() or 1,
                metavar="N",
                help="threads for assembly (1)" if verb in assembling else "number of processes",
            )
        if verb in (demo, scene, invert, compared, many):
            add_executor(verb)
        verb.add_argument("--overwrite", action="store_true", help="replace existing results")
        verb.add_argument("-q", dest="quiet", action="store_true", help="no progress and no summary, warnings only")
    for name, verb in verbs.choices.items():
        add_examples(name, verb)
    return command, dict(verbs.choices)


def add_executor(verb: argparse.ArgumentParser) -> None:
    """Add `--executor` to a verb with independent tasks."""
    verb.add_argument(
        "--executor",
        metavar="WHO",
        help="executor of independent tasks, in place of --threads: N processes, dask:ADDRESS, mpi[:N] or slurm[:KEY=VALUE,...]",
    )


def _demo(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser(
        "demo", help="three retraction protocols on the demonstration head"
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--head", choices=["mni152", "idealised"], default="mni152", help="the head (mni152)")
    which.add_argument("--image", metavar="FILE", help="a T1 scan (NIfTI) of another head, with skull or without")
    parser.add_argument("--fast", action="store_true", help="a coarse mesh and shorter protocols")
    return parser


def _mesh(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser(
        "mesh",
        help="a volume mesh from a scan, a label map, closed surfaces, or another program's mesh",
        epilog="A place is X,Y,Z in mm in the file's coordinates, voxel:I,J,K of the file from 0, or the name of a landmark.",
    )
    parser.add_argument(
        "images",
        metavar="IMAGE",
        nargs="+",
        help="a T1 scan (NIfTI, MGH, a folder of DICOM files or one of them); with --labels a label map; closed surfaces "
        "[NAME=]FILE, outer ones first (STL, PLY, OBJ, OFF, GIfTI, FreeSurfer's lh.pial); or a mesh of tetrahedra (Gmsh, "
        "Abaqus, VTK, FEBio, Netgen, Medit, XDMF)",
    )
    parser.add_argument("--labels", action="store_true", help="IMAGE is a label map")
    parser.add_argument(
        "--names",
        type=types.names,
        default=(None, {}),
        metavar="N=NAME,…",
        help=f"names of the labels, or one of {', '.join(SCHEMES)}, followed by further N=NAME,…",
    )
    parser.add_argument("--unit", choices=UNITS, help="unit of length in surfaces and meshes that do not state it (mm)")
    parser.add_argument(
        "--mesh-unit", choices=MESH_UNITS, default="m", help="unit of length in a mesh file of another program (m)"
    )
    parser.add_argument("--no-fill", action="store_true", help="do not fill unlabelled sulci with fluid")
    parser.add_argument(
        "--structures", action="store_true", help="split tissues: left, right, cerebellum, stem, deep grey, callosum"
    )
    parser.add_argument(
        "--atlas",
        type=Path,
        metavar="LABELS",
        help="regions of your own atlas, transferred to the scan by registration of",
    )
    parser.add_argument("--atlas-t1", type=Path, metavar="T1", help="the T1 of the atlas, with skull or without")
    parser.add_argument("--route", choices=ROUTES, help="meshing method (hull)")
    parser.add_argument(
        "--size", type=types.length, metavar="MM", help="element size, away from the site if there is one"
    )
    parser.add_argument("--site", metavar=PLACE, help="centre of a refined region")
    parser.add_argument(
        "--near", type=types.length, default=2e-3, metavar="MM", help="element size at the site or cut (2)"
    )
    parser.add_argument(
        "--radius",
        type=types.length,
        metavar="MM",
        help="radius of the refined region (hull 17, lattice 10.5, conforming 20)",
    )
    parser.add_argument(
        "--surfaces", action="store_true", help="write white and pial surfaces and cortical thickness too, as GIfTI"
    )
    parser.add_argument("--curve", action="store_true", help="second-order elements that follow the tissue interfaces")
    parser.add_argument(
        "--landmark", action="append", default=[], metavar="NAME=PLACE", help="name a place; can be repeated"
    )
    cut = parser.add_argument_group("a cut", "a cleft with plane walls under a craniotomy")
    cut.add_argument("--cut", metavar=PLACE, help="centre of its floor, a place in tissue")
    cut.add_argument("--opening", type=types.length, metavar="MM", help="distance between its walls (4)")
    cut.add_argument("--width", type=types.length, metavar="MM", help="width along its walls (12)")
    cut.add_argument("--craniotomy", type=types.length, metavar="MM", help="diameter of the hole in the skull (40)")
    cut.add_argument("--approach", type=types.direction, metavar=PLACE, help="direction outwards (the shortest way)")
    cut.add_argument(
        "--across", type=types.direction, metavar=PLACE, help="direction from wall to wall (left to right)"
    )
    return parser


def _add_reading(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--template", action=PrintText, of=sidecar_template, nargs=0, help="print a NIfTI sidecar template, and stop"
    )
    parser.add_argument(
        "--conjugate",
        action="store_true",
        help="take the complex conjugate: DATA has the time convention e^{-iωt}, or its phase images are in reverse order",
    )
    parser.add_argument(
        "--bids",
        default="",
        metavar="sub-LABEL[_ses-LABEL]",
        help="copy the maps into a BIDS derivative dataset of this subject, bids_derivative in the folder of the results",
    )


def _invert(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser("invert", help="property maps from wave data")
    parser.add_argument("data", type=Path, metavar="DATA", help="wave data: .npz, .h5, .mat or NIfTI with its sidecar")
    _add_reading(parser)
    parser.add_argument(
        "--noise",
        type=float,
        metavar="SIGMA",
        help="noise level, relative to each component's rms (from DATA, or estimated)",
    )
    parser.add_argument(
        "--model-error",
        type=float,
        metavar="SIGMA",
        help="model error, likewise (0; required for static ultrasound)",
    )
    parser.add_argument(
        "--discretisation",
        choices=DISCRETISATIONS,
        help="the data's own elements or a generated mesh (the data's, if there are any)",
    )
    parser.add_argument(
        "--regulariser",
        choices=("auto", *PRIORS),
        default="auto",
        help="prior; auto: smooth or edges, by cross-validation, and steps for static ultrasound",
    )
    parser.add_argument(
        "--weight",
        choices=WEIGHTINGS,
        default="evidence",
        help="choice of the regularisation weight (evidence)",
    )
    parser.add_argument(
        "--starts",
        choices=STARTS,
        default="auto",
        help="initial guesses: measured waves, uniform fields too (all), or several levels of uniform fields (many); auto: all in "
        "the plane, waves in space",
    )
    parser.add_argument(
        "--start",
        choices=("surrogate",),
        help="use the maps of the trained operator (see `predict`) as the only initial guess, with measured waves; in the plane",
    )
    parser.add_argument(
        "--rounds",
        type=int,
        metavar="N",
        help="largest number of iterations from an initial guess, and of a subzone; a large body needs few (96 in the plane, 16 in "
        "space)",
    )
    parser.add_argument(
        "--unknowns",
        choices=UNKNOWNS,
        default="moduli",
        help="parametrisation: storage and loss modulus (moduli), or magnitude and phase (polar)",
    )
    parser.add_argument(
        "--misfit",
        choices=MISFITS,
        default="squares",
        help="least squares, or Huber loss for outliers that --drop-outliers misses (squares)",
    )
    parser.add_argument(
        "--drop-outliers",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="leave out displacements that deviate from a smooth field (yes)",
    )
    parser.add_argument(
        "--oss-snr",
        type=float,
        metavar="LEAST",
        help="restrict to points with at least this signal-to-noise ratio of octahedral shear strain in some load (such as 3)",
    )
    parser.add_argument(
        "--by-label",
        action="store_true",
        help="separate fields for each label of DATA, discontinuous between labels",
    )
    parser.add_argument(
        "--bars",
        action="store_true",
        help="error bars: credible intervals at every point, of the mean and of labels' means, under the prior with the largest "
        "evidence; in the plane this takes up to three times as long",
    )
    parser.add_argument(
        "--subzones",
        action="store_true",
        help="3-D data in overlapping subzones, --threads of them at a time, or on an --executor; an interrupted run continues",
    )
    parser.add_argument(
        "--device",
        choices=DEVICES,
        default="cpu",
        help="linear solver: cuda factorises on an NVIDIA GPU (cuDSS); ngsolve solves on a GPU with factors from the CPU; auto is "
        "the CPU unless a GPU was measured to be faster (cpu)",
    )
    return parser


def _predict(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser(
        "predict", help="property maps from wave data by a trained operator, in seconds"
    )
    parser.add_argument("data", type=Path, metavar="DATA", help="wave data: .npz, .h5, .mat or NIfTI with its sidecar")
    _add_reading(parser)
    parser.add_argument(
        "--weights", type=Path, metavar="DIR", help="weights from `python -m ngbrain.surrogate` (those of the package)"
    )
    return parser


def _calibrate(verbs: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser(
        "calibrate", help="tissue stiffness of a patient from landmarks and forces of a retraction"
    )
    parser.add_argument(
        "scene", type=Path, metavar="SCENE.toml", help="the operation that was measured, see `simulate`"
    )
    parser.add_argument(
        "--template",
        action=PrintText,
        of=table_template,
        choices=TABLES,
        help="print a commented table, of landmarks or of forces, and stop (`simulate --template`: the scene)",
    )
    parser.add_argument(
        "--landmarks",
        type=Path,
        metavar="FILE.csv",
        help="columns t_s, x_mm, y_mm, z_mm (initial position), ux_mm, uy_mm, uz_mm (displacement)",
    )
    parser.add_argument("--landmark-sd", type=float, metavar="MM", help="standard deviation of a displacement")
    parser.add_argument(
        "--force", type=Path, metavar="FILE.csv", help="columns t_s, force_N (force of the blade, across the cleft)"
    )
    parser.add_argument("--force-sd", type=float, metavar="N", help="standard deviation of a force")
    parser.add_argument(
        "--tissues", metavar="NAMES", help="tissues to calibrate: regions of the scene, separated by commas (all)"
    )
    parser.add_argument("--protocol", metavar="NAME", help="the scene's protocol that was measured (the first)")
    add_laws(parser)
    parser.add_argument(
        "--spread",
        type=float,
        default=SPREAD,
        metavar="FACTOR",
        help=f"prior standard deviation of a tissue's stiffness factor ({SPREAD:g})",
    )
    parser.add_argument(
        "--no-finer",
        dest="finer",
        action="store_false",
        help="without the run on finer elements: the discretisation error is then neither corrected nor part of the intervals",
    )
    return parser


def _materials(verbs: Any) -> None:
    parser = verbs.add_parser(
        "materials",
        help="published constants of tissues, by the names that scenes take",
        description="List the published constants that scenes take by name, or show one in detail.",
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help="a name, or a part of several names; all by default")
    parser.add_argument(
        "--laws",
        nargs="?",
        const="",
        metavar="FILE.py",
        help="list the laws that scenes take by name, with their parameters; and those of your own file, which is run",
    )
    parser.add_argument(
        "--template",
        action=PrintText,
        of=law_template,
        nargs=0,
        help="print a commented file for --laws, with a law, and stop",
    )
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE.png",
        help="plot stress against stretch of the listed entries, over the stretches of their data (.pdf, .svg)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an existing plot")
    parser.set_defaults(quiet=False, output=None)


def _data(verbs: Any) -> None:
    parser = verbs.add_parser("data", help="sample data: a list, or files")
    parser.add_argument("names", nargs="*", metavar="NAME", help="data to write; without a name all are listed")
    parser.add_argument(
        "-o", dest="output", type=Path, default=Path(), metavar="DIR", help="folder of the files (this folder)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace existing files")
    parser.add_argument("-q", dest="quiet", action="store_true", help="do not print the files")


def _doctor(verbs: Any) -> None:
    parser = verbs.add_parser(
        "doctor",
        help="what is installed here, what is missing and how to get it, what is slow",
        description="Say which packages are installed, how many cores and how much memory there are, where files are cached, "
        "and what is missing or slow, with what helps. Exit status 3 if the core does not work.",
    )
    parser.add_argument(
        "--no-timing", dest="timing", action="store_false", help="do not measure the solver and the disk"
    )
    parser.set_defaults(quiet=False, output=None)
