"""Reference pages that are written from the code: the command line, the scene file, the numbers of an operation."""

from __future__ import annotations

import argparse
import configparser
import re
import textwrap
from collections.abc import Iterable

import stage

from ngbrain.cli.options.common import parser, parsers
from ngbrain.cli.options.help_page import GROUPS
from ngbrain.scene import Scene
from ngbrain.scene.schema import reference
from ngbrain.surgery.quantities import QUANTITIES

HOWTO = {
    "demo": "howto/retraction.md",
    "simulate": "howto/retraction.md",
    "mesh": "howto/head_mesh.md",
    "invert": "howto/stiffness_from_waves.md",
    "predict": "howto/stiffness_at_once.md",
    "calibrate": "howto/calibrate.md",
    "twin": "howto/twin.md",
    "cohort": "howto/cohort.md",
    "materials": "howto/laws.md",
    "data": "install.md",
    "doctor": "install.md",
}
"""The page that each verb is explained on."""


def add(pages: stage.Pages) -> None:
    """Stage these pages."""
    pages.write("reference/commands.md", commands())
    pages.write("reference/scene.md", reference(Scene))
    pages.write("reference/operation_keys.md", operation_keys())
    pages.write("reference/extras.md", extras())


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table of Markdown."""
    lines = [list(head), ["---"] * len(list(head)), *map(list, rows)]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", r"\|").replace("\n", " ") for cell in row) + " |" for row in lines
    )


def about(verb: str) -> str:
    """What the list of commands says of a verb."""
    (verbs,) = (action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
    return next((action.help or "" for action in verbs._choices_actions if action.dest == verb), "")


def commands() -> str:
    """Every verb with its options."""
    parts = [
        "# The command line",
        "`ngbrain VERB …`, or `python -m ngbrain VERB …`. A command ends with 0 where its answer may be used, with 2 for bad "
        "input, in one line that says what was found and what is wanted, and with 3 where a solver gave up or the answer is not to "
        "be used. Options may be shortened as long as they stay unique. This page is what `ngbrain VERB --help` prints.",
        table(
            ("", "verb", "does"),
            (
                (group if verb == verbs[0] else "", f"[`{verb}`](#ngbrain-{verb})", about(verb))
                for group, verbs in GROUPS.items()
                for verb in verbs
            ),
        ),
    ]
    for verb, command in ((verb, parsers()[verb]) for verbs in GROUPS.values() for verb in verbs):
        parts += [f"## `ngbrain {verb}`", sentence(about(verb))]
        if verb in HOWTO:
            parts.append(f"How to use it: [{title(HOWTO[verb])}](../{HOWTO[verb]}).")
        parts.append(f"```text\n{usage(command)}\n```")
        for group in command._action_groups:
            actions = [action for action in group._group_actions if action.help != argparse.SUPPRESS]
            if actions:
                heading = (group.title or "").capitalize()
                parts.append(f"**{heading}**" + (f": {escape(group.description)}" if group.description else ""))
                parts.append(table(("", ""), ((shown(action), meaning(command, action)) for action in actions)))
        if command.epilog:
            parts.append(epilog(command))
    return "\n\n".join(parts) + "\n"


def usage(command: argparse.ArgumentParser) -> str:
    """The line of usage, folded for a page."""
    words, lines = re.findall(r"\[[^\]]*\](?: \.\.\.\])?|\S+", command.format_usage().removeprefix("usage: ")), [""]
    for word in words:
        if len(lines[-1]) + len(word) > 88:
            lines.append("   ")
        lines[-1] += (" " if lines[-1] else "") + word
    return "\n".join(lines)


def epilog(command: argparse.ArgumentParser) -> str:
    """The text after the options: prose as it is, examples as code."""
    prose, _, examples = (command.epilog or "").partition("examples:\n")
    return escape(prose.strip()) + (f"\n\n```sh\n{textwrap.dedent(examples).strip()}\n```" if examples else "")


def shown(action: argparse.Action) -> str:
    """An option as it is given."""
    value = action.metavar or (action.dest if not action.option_strings else "")
    if action.choices and not action.metavar:
        value = "{" + ",".join(map(str, action.choices)) + "}"
    value = " ".join(value) if isinstance(value, tuple) else value
    if not action.option_strings:
        return f"`{value}`"
    takes = f" {value}" if action.nargs != 0 and value else ""
    return ", ".join(f"`{option}{takes}`" for option in action.option_strings)


def meaning(command: argparse.ArgumentParser, action: argparse.Action) -> str:
    """Its help, with defaults filled in."""
    return escape(command._get_formatter()._expand_help(action)) if action.help else ""


def escape(text: str) -> str:
    """Plain text as Markdown."""
    return re.sub(r"([*_<{])", r"\\\1", text)


def sentence(text: str) -> str:
    """Words of a list as a sentence."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


def title(page: str) -> str:
    """The heading of a page of the guide."""
    return (stage.GUIDE / page).read_text().partition("\n")[0].lstrip("# ")


def operation_keys() -> str:
    """The numbers of a protocol's answer."""
    rows = (
        (f"`{each.key}`", each.name, each.unit or "–", "" if each.describes else each.scaling.value)
        for each in QUANTITIES.values()
    )
    parts = (
        "# The numbers of an operation",
        "`answers` of an operation's `result.json` maps each protocol to these numbers. The last column says what becomes of a "
        "number when all moduli are multiplied by one factor while the tool goes the same way; empty: it describes the run.",
        table(("key", "what", "unit", "with stiffer tissue"), rows),
        "`series` has the curves: `t_s`, `opening_mm`, `blade_mm`, `force_N`, `contact_area_mm2`, `pressure_mmHg`, "
        "`tip_pressure_mmHg`, `centre_pressure_mmHg`, `min_gap_mm`. Other keys are on [result.json](results.md).",
    )
    return "\n\n".join(parts) + "\n"


def extras() -> str:
    """What each extra of the package brings."""
    config = configparser.ConfigParser()
    config.read(stage.ROOT / "setup.cfg")

    def named(lines: str) -> str:
        return ", ".join(f"`{each}`" for each in lines.split("\n") if each)

    parts = (
        "# Packages that extras bring",
        f'`pip install ".[EXTRA]"` in a clone. Without an extra ngbrain needs {named(config["options"]["install_requires"])}; '
        "what needs another package says in one line which extra brings it.",
        table(("extra", "brings"), ((f"`{e}`", named(lines)) for e, lines in config["options.extras_require"].items())),
    )
    return "\n\n".join(parts) + "\n"
