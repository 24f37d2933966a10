"""Which numbers of tests changed between two commits, and in which: tolerances, reference values, sizes; function by function.

usage: compare_tests.py OLD NEW [FOLDER …]       commits; folders of tests/ (default: forward stability verification)

A function that moved to another file is found by its name; one that is no longer there is listed, a new one is not.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

FOLDERS = ("forward", "stability", "verification")
MODULE = "constants of the file"


@dataclass(frozen=True)
class Change:
    """Numbers of a function of the old version that the new one does not have, and the other way round.

    commits   those in which they changed, in order
    """

    file: str
    name: str
    before: tuple[float, ...]
    after: tuple[float, ...] | None
    commits: tuple[str, ...] = ()

    @property
    def what(self) -> str:
        """Before and after."""
        return "is no longer there" if self.after is None else f"{_listed(self.before)} → {_listed(self.after)}"


def changes(old: str, new: str, folders: tuple[str, ...] = FOLDERS) -> list[Change]:
    """All changes of numbers in tests from one commit to another."""
    before, after = _numbers(old, folders), _numbers(new, ())
    anywhere: dict[str, list[Counter]] = {}
    for (_, name), numbers in after.items():
        anywhere.setdefault(name, []).append(numbers)
    found = []
    for (file, name), numbers in before.items():
        same = after.get((file, name))
        candidates = [same] if same is not None else [] if name == MODULE else anywhere.get(name, [])
        if not candidates:
            if numbers:
                gone = tuple(sorted(numbers.elements()))
                found.append(Change(file, name, gone, None, _commits(old, new, file, name, numbers)))
            continue
        nearest = min(candidates, key=lambda other: ((numbers - other) + (other - numbers)).total())
        gone, come = (tuple(sorted(part.elements())) for part in (numbers - nearest, nearest - numbers))
        if gone or come:
            found.append(Change(file, name, gone, come, _commits(old, new, file, name, numbers)))
    return found


def _commits(old: str, new: str, file: str, name: str, numbers: Counter) -> tuple[str, ...]:
    """Subjects of the commits in which a function's numbers changed."""
    found, last = [], numbers
    for line in _git("log", "--reverse", "--format=%h %s", f"{old}..{new}", "--", file).splitlines():
        commit, subject = line.split(" ", 1)
        there = _git("ls-tree", "--name-only", commit, "--", file)
        now = _of_file(_git("show", f"{commit}:{file}")).get(name, Counter()) if there else Counter()
        if now != last:
            found.append(subject)
        last = now
    return tuple(found)


def _numbers(commit: str, folders: tuple[str, ...]) -> dict[tuple[str, str], Counter]:
    """(file, function) → how often each number stands in it."""
    where = [f"tests/{folder}" for folder in folders] or ["tests"]
    listed = _git("ls-tree", "-r", "--name-only", commit, "--", *where).splitlines()
    return {
        (file, name): numbers
        for file in listed
        if file.endswith(".py")
        for name, numbers in _of_file(_git("show", f"{commit}:{file}")).items()
    }


def _of_file(text: str) -> dict[str, Counter]:
    found: dict[str, Counter] = {MODULE: Counter()}
    for node in ast.parse(text).body:
        name = node.name if isinstance(node, ast.FunctionDef | ast.ClassDef) else MODULE
        found.setdefault(name, Counter()).update(_literals(node))
    return found


def _literals(node: ast.AST) -> Iterator[float]:
    """Numbers in some code, with their signs."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant):
        yield from (-value for value in _literals(node.operand))
    elif isinstance(node, ast.Constant):
        if isinstance(node.value, int | float) and not isinstance(node.value, bool):
            yield float(node.value)
    else:
        for child in ast.iter_child_nodes(node):
            yield from _literals(child)


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], capture_output=True, text=True, check=True).stdout


def _listed(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers) or "none"


def main(old: str, new: str, *folders: str) -> None:
    """Print all changes, by the commits in which they were made."""
    found = changes(old, new, folders or FOLDERS)
    for commits in dict.fromkeys(change.commits for change in found):
        print("; ".join(commits) or "moved")
        print(
            "\n".join(f"  {change.file}::{change.name}: {change.what}" for change in found if change.commits == commits)
        )
    print(f"{len(found)} functions with other numbers")


if __name__ == "__main__":
    main(*sys.argv[1:])
