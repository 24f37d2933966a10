"""Options that print a text and end the command."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any


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
        print(self.of(value), end="")
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


def _json(schema: dict[str, Any]) -> str:
    import json

    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
