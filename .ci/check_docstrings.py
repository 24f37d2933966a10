"""Fail where a public function, method or class of two arguments or more does not document each of them in a numpydoc section.

usage: check_docstrings.py [PACKAGE]

The names under `Parameters` have to be those of the signature; a class documents the arguments of its constructor, a dataclass
its fields, under `Parameters` or `Attributes`.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

SECTION = re.compile(r"^(Parameters|Other Parameters|Attributes)\n-+\n(.*?)(?=^\w[\w ]*\n-{3,}\n|\Z)", re.M | re.S)
ENTRY = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: :.*)?$", re.M)
PASSED_OVER = {"property", "cached_property", "setter", "overload", "classmethod"}


def documented(docstring: str) -> set[str]:
    """Names in the sections of a docstring."""
    return {
        name.strip(" *")
        for _, section in SECTION.findall(docstring)
        for entry in ENTRY.findall(section)
        for name in entry.split(",")
    }


def arguments(function: ast.FunctionDef) -> list[str]:
    """Names that a caller gives."""
    given = function.args
    return [a.arg for a in [*given.posonlyargs, *given.args, *given.kwonlyargs] if a.arg not in ("self", "cls")]


def decorators(node: ast.FunctionDef | ast.ClassDef) -> set[str]:
    """Their last names."""
    calls = (d.func if isinstance(d, ast.Call) else d for d in node.decorator_list)
    return {d.attr if isinstance(d, ast.Attribute) else getattr(d, "id", "") for d in calls}


def constructor(node: ast.ClassDef) -> list[str]:
    """Arguments of its `__init__`, or the public fields of a dataclass."""
    for item in node.body:
        if isinstance(item, ast.FunctionDef) and item.name == "__init__":
            return arguments(item)
    if "dataclass" not in decorators(node):
        return []
    fields = [i for i in node.body if isinstance(i, ast.AnnAssign) and isinstance(i.target, ast.Name)]
    return [
        i.target.id
        for i in fields
        if not i.target.id.startswith("_")
        and "ClassVar" not in ast.unparse(i.annotation)
        and not (i.value and "init=False" in ast.unparse(i.value))
    ]


def public(tree: ast.Module) -> Iterator[tuple[str, int, list[str], str]]:
    """Name, line, arguments and docstring of what has to have sections."""
    for node in tree.body:
        if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name.startswith("_"):
            continue
        methods = [node]
        if isinstance(node, ast.ClassDef):
            yield node.name, node.lineno, constructor(node), ast.get_docstring(node) or ""
            methods = [m for m in node.body if isinstance(m, ast.FunctionDef) and not m.name.startswith("_")]
            methods = [m for m in methods if not decorators(m) & PASSED_OVER]
        for method in methods:
            if isinstance(method, ast.FunctionDef):
                yield method.name, method.lineno, arguments(method), ast.get_docstring(method) or ""


def faults(package: Path) -> Iterator[str]:
    """One line for each docstring that does not do."""
    for file in sorted(package.rglob("*.py")):
        for name, line, names, docstring in public(ast.parse(file.read_text(encoding="utf-8"))):
            found = documented(docstring)
            if len(names) < 2:
                continue
            if missing := [each for each in names if each not in found]:
                yield f"{file}:{line}: {name} does not document {', '.join(missing)}"


if __name__ == "__main__":
    lines = list(faults(Path(sys.argv[1] if len(sys.argv) > 1 else "ngbrain")))
    print(*lines, sep="\n")
    sys.exit(f"{len(lines)} docstrings do not document their arguments" if lines else 0)
