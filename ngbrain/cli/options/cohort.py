"""Options of the verb `cohort`, and the options of other verbs that its list can contain."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ngbrain.cli.options.print_text import PrintText

VERBS = ("mesh", "invert", "predict", "simulate")
"""Verbs of the rows."""
SAMPLE = Path(__file__).parents[2] / "samples" / "cohort.csv"
OWN = ("help", "output", "overwrite", "own_laws", "quiet", "resume", "threads", "executor")
"""Destinations of options that a list cannot contain: those that a cohort sets itself, and files of code that would be run."""


def add_cohort(verbs: Any) -> argparse.ArgumentParser:
    """Add the parser of `cohort`; output, threads, overwriting and quiet are added as for other verbs."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        "cohort",
        help="many scans or cases through one of the verbs: one table, one report",
        epilog="The same command continues an interrupted cohort, and computes the new rows of a longer list.",
    )
    parser.add_argument("list", type=Path, metavar="LIST.csv", help="a row for each: name, verb, input, options")
    parser.add_argument(
        "--template",
        action=PrintText,
        of=_sample,
        nargs=0,
        help="print a commented list, and stop",
    )
    parser.add_argument(
        "--verb", dest="of_rows", choices=VERBS, help="verb of all rows, for a list without that column"
    )
    parser.add_argument(
        "--group", metavar="COLUMN", help="column of the groups for statistics (group, if there is one)"
    )
    return parser


def columns_of(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """Options of a verb's parser that a column can contain, by their long names without dashes."""
    found = {}
    for action in parser._actions:  # what argparse itself has no public name for
        names = [name[2:] for name in action.option_strings if name.startswith("--")]
        printing = action.nargs == 0 and type(action).__module__ != "argparse"
        if names and action.dest not in OWN and not printing:
            found[names[0]] = action
    return found


def several_inputs(parser: argparse.ArgumentParser) -> bool:
    """Whether a verb takes several files."""
    return any(not action.option_strings and action.nargs == "+" for action in parser._actions)


def is_path(action: argparse.Action) -> bool:
    """Whether an option's value is a file or folder."""
    return action.type is Path


def _sample(_: object) -> str:
    return SAMPLE.read_text(encoding="utf-8")
