"""Options of the verb `simulate`; nothing that would delay `--help` is imported."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ngbrain.cli.options.print_text import PrintText, scene_schema, scene_template

TEMPLATES = ("operation", "body")
"""Kinds of scene with a template."""


def add_simulate(verbs: Any) -> argparse.ArgumentParser:
    """Add the parser of `simulate`."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        "simulate",
        help="a scene: an operation, or a body under loads",
        epilog="A scene with quantities and tolerances is answered by the cheapest model within the tolerances.",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE.toml", help="the scene; --template prints one")
    parser.add_argument(
        "--template",
        action=PrintText,
        of=scene_template,
        nargs="?",
        const="operation",
        choices=TEMPLATES,
        help="print a commented scene, of an operation or of a body under loads, and stop",
    )
    parser.add_argument(
        "--schema", action=PrintText, of=scene_schema, nargs=0, help="print the JSON schema of a scene, and stop"
    )
    add_laws(parser)
    parser.add_argument(
        "--as-described",
        action="store_true",
        help="compute the scene as written, without model selection",
    )
    parser.add_argument(
        "--preview",
        action="store_true",
        help="draw geometry, regions, conditions, cleft and tool in preview.html, and stop",
    )
    return parser


def add_laws(parser: argparse.ArgumentParser) -> None:
    """Add the option for user-defined laws."""
    parser.add_argument(
        "--laws",
        dest="own_laws",
        action="append",
        type=Path,
        metavar="FILE.py",
        help="a Python file, which is run, with laws that the scene can name; see `ngbrain materials --laws FILE.py`",
    )
