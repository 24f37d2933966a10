"""The verb `doctor`: what is installed, missing and slow here."""

from __future__ import annotations

import argparse

from ngbrain.cli import EXIT_SOLVER
from ngbrain.workflows.doctor import BROKEN, OK, OPTIONAL, SLOW, Finding, diagnose

MARKS = {OK: " ", OPTIONAL: "-", SLOW: "!", BROKEN: "x"}


def run(arguments: argparse.Namespace) -> int:
    """Print findings as they come, then a line for each kind that needs something; returns 3 where the core does not work."""
    found, topic = list[Finding](), ""
    for finding in diagnose(arguments.timing):
        if finding.topic != topic:
            topic = finding.topic
            print(f"{topic}", flush=True)
        found.append(finding)
        print(f"{MARKS[finding.state]} {finding.name:<22}{finding.value}", flush=True)
        if finding.advice:
            print(f"  {'':<22}→ {finding.advice}", flush=True)
    print()
    print("\n".join(summary(found)))
    return EXIT_SOLVER if any(each.state == BROKEN for each in found) else 0


def summary(found: list[Finding]) -> list[str]:
    """A line for each state that was met: what does not work, what is slow, which extras are missing.

    >>> summary([Finding("core", "numpy", "2.4.6"), Finding("extras", "viz", "ipython missing", OPTIONAL)])
    ['works', 'not installed, which only some need (-): viz']
    """
    names = {state: ", ".join(each.name for each in found if each.state == state) for state in MARKS}
    lines = [f"does not work (x): {names[BROKEN]}" if names[BROKEN] else "works"]
    if names[SLOW]:
        lines.append(f"slow, or soon full (!): {names[SLOW]}")
    if names[OPTIONAL]:
        lines.append(f"not installed, which only some need (-): {names[OPTIONAL]}")
    return lines
