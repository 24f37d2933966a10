"""Options of the verb `twin`; nothing that would delay `--help` is imported."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ngbrain.cli.options.print_text import PrintText, case_schema, case_template

DRAWS = 6


def add_twin(verbs: Any) -> argparse.ArgumentParser:
    """Add the parser of `twin`."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        "twin",
        help="one patient's surgical plans compared, with what is not known carried through",
        epilog="Plans are compared by draws of the patient that they share; a difference smaller than what is not known is open.",
    )
    parser.add_argument("case", type=Path, metavar="CASE.toml", help="the patient and the plans; --template prints one")
    parser.add_argument(
        "--template", action=PrintText, of=case_template, nargs=0, help="print a commented case, and stop"
    )
    parser.add_argument(
        "--schema", action=PrintText, of=case_schema, nargs=0, help="print the JSON schema of a case, and stop"
    )
    parser.add_argument(
        "--draws",
        type=int,
        default=DRAWS,
        metavar="N",
        help=f"whole runs of each plan, which check the intervals ({DRAWS})",
    )
    parser.add_argument("--quick", action="store_true", help="a first answer by coarse elements, without whole runs")
    return parser
