"""Options that print a text and end the command."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ngbrain.errors import NgbrainError

LAW = '''\
# A law of your own, as a file of Python. Tissue is made of it by a line of a scene, relative to the scene's file,
#     material = { path = "my_laws.py:Quartic", mu_Pa = 900.0, k = 0.3 }
# or by its name, with the file given by hand:
#     material = { name = "Quartic", mu_Pa = 900.0, k = 0.3 }      # ngbrain simulate SCENE.toml --laws my_laws.py
# `ngbrain materials --laws my_laws.py` checks it: no stress at rest, no change under rotations, its modulus, ellipticity.
from dataclasses import dataclass

import ngsolve as ngs


@dataclass(frozen=True)
class Quartic:
    """W = mu/2 (I1 - 3) + mu k (I1 - 3)^2 of the isochoric C; stress and tangent follow by differentiation."""

    mu_Pa: float  # keys of the scene are these arguments
    k: float = 0.5
    stretch = (0.9, 1.1)  # how far it is meant for; 0.8 to 1.25 if this line is left out

    @property
    def initial_modulus(self):
        """The shear modulus at rest, Pa."""
        return self.mu_Pa

    def energy(self, C):
        """The energy density, Pa, by NGSolve's functions."""
        beyond = ngs.Trace(C) - 3
        return self.mu_Pa / 2 * beyond + self.mu_Pa * self.k * beyond**2
'''
LANDMARKS = """\
# Where landmarks went, in the coordinates of the head (mm): a row for each landmark and time; not measured: an empty cell.
# ngbrain calibrate SCENE.toml --landmarks FILE.csv --landmark-sd MM
# t_s: time from the beginning of the protocol; x, y, z: where the landmark was before; ux, uy, uz: how far it has moved since
t_s,x_mm,y_mm,z_mm,ux_mm,uy_mm,uz_mm
2.5,29.2,18.2,26.8,0.07,0.20,-0.27
2.5,8.4,-11.9,21.5,0.00,0.04,
5,29.2,18.2,26.8,0.26,0.75,-1.02
"""
FORCE = """\
# The force of the tool on the tissue, across the cleft: a row for each time.
# ngbrain calibrate SCENE.toml --force FILE.csv --force-sd N
# t_s: time from the beginning of the protocol
t_s,force_N
2.5,0.29
5,1.10
7.5,0.88
"""


class PrintText(argparse.Action):
    """Print a text, such as a template, and end the command.

    Parameters
    ----------
    of : callable
        From the option's value to the text; called when the option is given, so that `--help` imports nothing for it.
    options : Any
        Those of `argparse.Action`.
    """

    def __init__(self, of: Callable[[Any], str], **options: Any) -> None:
        super().__init__(**options)
        self.of = of

    def __call__(self, parser: argparse.ArgumentParser, _: object, value: Any, *__: object) -> None:
        """Print and exit."""
        try:
            text = self.of(value)
        except NgbrainError as error:
            parser.exit(2, f"ngbrain: {error}\n")
        print(text, end="")
        parser.exit()


def scene_template(kind: str) -> str:
    """A commented scene, of an operation or of a body under loads."""
    from ngbrain.scene import Scene

    return Scene.template(kind)


def scene_schema(_: object) -> str:
    """JSON schema of a scene."""
    from ngbrain.scene import Scene

    return _json(Scene.schema())


def case_template(_: object) -> str:
    """A commented case of the twin."""
    from ngbrain.surgery.twin.case import Case

    return Case.template()


def case_schema(_: object) -> str:
    """JSON schema of a case of the twin."""
    from ngbrain.scene.schema import json_schema
    from ngbrain.surgery.twin.case import Case

    return _json(json_schema(Case))


def sidecar_template(_: object) -> str:
    """A sidecar of wave data."""
    from ngbrain.io.waves.nifti import TEMPLATE

    return TEMPLATE


def table_template(kind: str) -> str:
    """A commented table of `calibrate`: landmarks or force."""
    return {"landmarks": LANDMARKS, "force": FORCE}[kind]


def law_template(_: object) -> str:
    """A commented file of Python with a law of one's own."""
    return LAW


def completion_script(shell: str) -> str:
    """The script that completes verbs, options and file names in a shell."""
    from ngbrain.cli.options.common import parser
    from ngbrain.errors import require

    shtab = require("shtab", "completion")
    command = parser()
    (verbs,) = (action for action in command._actions if isinstance(action, argparse._SubParsersAction))
    for verb in verbs.choices.values():
        for action in verb._actions:
            if action.type is Path or action.dest in ("images", "image"):
                action.complete = shtab.FILE
    return str(shtab.complete(command, shell)).rstrip("\n") + "\n"


def _json(schema: dict[str, Any]) -> str:
    import json

    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
