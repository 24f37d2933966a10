"""Parsers of the command line: errors of one line, help with verbs in groups and examples at its end."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

GROUPS = {
    "Data in": ("data", "mesh"),
    "Simulation": ("demo", "simulate"),
    "Elastography": ("invert", "predict"),
    "Patient": ("calibrate", "twin", "cohort"),
    "Look up": ("materials", "doctor"),
}
"""Verbs by what they are for, in the order of the help."""
EXAMPLES = {
    "demo": (
        ("ngbrain demo --fast -o demo", "ten minutes on two cores; demo/report.html"),
        ("ngbrain demo --image T1.nii.gz --quick", "the demo's cleft at the like place of your scan"),
    ),
    "simulate": (
        ("ngbrain simulate --template > my.toml", "a commented scene to change"),
        ("ngbrain simulate my.toml --preview", "head, cleft and tool drawn, within a minute"),
        ("ngbrain simulate my.toml --quick -o out", "first answers soon, then the scene as described"),
    ),
    "mesh": (
        ("ngbrain mesh T1.nii.gz -o head", "head/head.vtkhdf, its labels and a report"),
        ("ngbrain mesh T1.nii.gz --route conforming --site -20,0,30 --near 1", "finer at a place"),
        ("ngbrain mesh aseg.mgz --labels --names freesurfer -o head/head.msh", "from labels, for Gmsh"),
    ),
    "invert": (
        ("ngbrain invert --template > waves.json", "the sidecar of waves.nii.gz, to fill in"),
        ("ngbrain invert waves.nii.gz -o inverted", "maps of stiffness and damping"),
        ("ngbrain invert waves.npz --regulariser smooth --bars", "with error bars"),
    ),
    "predict": (
        ("ngbrain data waves_plane", "sample data: waves_plane.npz"),
        ("ngbrain predict waves_plane.npz -o predicted", "maps within seconds, and whether to trust them"),
    ),
    "calibrate": (
        ("ngbrain calibrate --template landmarks > landmarks.csv", "a table to fill in"),
        (
            "ngbrain calibrate retraction.toml --landmarks landmarks.csv --landmark-sd 0.5 -o calibrated",
            "by how landmarks moved",
        ),
        ("ngbrain simulate calibrated/scene.toml -o again", "another run with these tissues"),
    ),
    "twin": (
        ("ngbrain twin --template > case.toml", "a commented case to change"),
        ("ngbrain twin case.toml --quick -o twin", "a first comparison of the plans"),
    ),
    "cohort": (
        ("ngbrain cohort --template > list.csv", "a commented list to change"),
        ("ngbrain cohort list.csv -o cohort --threads 2", "two rows at a time; the same command continues"),
    ),
    "materials": (
        ("ngbrain materials cortex", "what is published of a region"),
        ("ngbrain materials griffiths2024:cortex", "all about one entry, and the lines for a scene"),
        ("ngbrain materials --template > my_laws.py", "a law of your own to change"),
        ("ngbrain materials --laws my_laws.py", "the laws that scenes can name, and those of the file"),
    ),
    "data": (
        ("ngbrain data", "what there is"),
        ("ngbrain data waves_plane plate -o samples", "two of them, into a folder"),
    ),
    "doctor": (
        ("ngbrain doctor", "what is installed, missing or slow here"),
        ("ngbrain doctor --no-timing", "without the measurements"),
    ),
}
"""Commands at the end of a verb's help, each with what it is for."""


class HelpLayout(argparse.HelpFormatter):
    """Folds descriptions as usual, but leaves a text of several lines as it is."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n" in text:
            return "\n".join(indent + line for line in text.splitlines())
        return super()._fill_text(text, width, indent)


class VerbParser(argparse.ArgumentParser):
    """Reports an error in one line; its help ends with the examples of the verb."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"formatter_class": HelpLayout, **options})

    def error(self, message: str) -> NoReturn:
        """End the command with status 2 and one line."""
        self.exit(2, f"{self.prog}: {' '.join(message.split())}; see {self.prog} --help\n")


class CommandParser(VerbParser):
    """The whole command: its help shows the verbs in groups."""

    def format_help(self) -> str:
        """The help."""
        (verbs,) = (action for action in self._actions if isinstance(action, argparse._SubParsersAction))
        lines = {action.dest: action for action in verbs._choices_actions}  # argparse has no public name for them
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        for title, names in GROUPS.items():
            formatter.start_section(title)
            formatter.add_arguments([lines[name] for name in names])
            formatter.end_section()
        formatter.start_section("Options")
        formatter.add_arguments([action for action in self._actions if action is not verbs])
        formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()


def add_examples(verb: str, parser: argparse.ArgumentParser) -> None:
    """End the help of a verb with its examples, after what its epilog says.

    Parameters
    ----------
    verb : str
    parser : argparse.ArgumentParser
        The parser of the verb, changed in place.
    """
    width = max(len(command) for command, _ in EXAMPLES[verb])
    lines = [f"  {command:<{width}}  # {purpose}" for command, purpose in EXAMPLES[verb]]
    parser.epilog = "\n".join([*([parser.epilog, ""] if parser.epilog else []), "examples:", *lines])
