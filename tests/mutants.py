"""Mutation check: the numerics changed in one place each, and whether the tests that execute that line notice.

    python tests/mutants.py --trace                 which tests execute which lines, once (out/mutants/lines.json)
    python tests/mutants.py --count 30 --seed 1     so many mutants, drawn; one line each, then how many were noticed
    python tests/mutants.py --only FUNCTION         all mutants of one function (module:qualified name)

A mutant has one operator or number of a function of `PACKAGES` changed. The tests that execute the line run in a copy of the
tree, the quickest first, and stop at the first that fails. Messages, docstrings, annotations and the checks of arguments are
left alone. Needs the extra `dev`.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("materials", "adjoint", "solvers", "inverse")
TESTS = [f"tests/{name}" for name in (*PACKAGES, "verification")]
LINES = ROOT / "out/mutants/lines.json"
BUDGET_S = 90.0
"""How long the tests of a mutant may take by the trace; the quickest come first."""
OTHER = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.MatMult: None,
    ast.Pow: ast.Mult,
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


@dataclass(frozen=True)
class Mutant:
    """A place and what stands there instead; `at` counts the changeable nodes of the file."""

    file: str
    function: str
    line: int
    at: int
    change: str


class Changeable(ast.NodeVisitor):
    """Nodes that can be changed, in the order of the text, with their functions."""

    def __init__(self) -> None:
        self.found: list[tuple[ast.AST, str]] = []
        self._where: list[str] = []

    def visit(self, node: ast.AST) -> None:
        """Go on, but not into what is left alone."""
        if isinstance(node, ast.Raise | ast.Assert | ast.AnnAssign | ast.JoinedStr | ast.arguments):
            return
        if isinstance(node, ast.If) and any(isinstance(inner, ast.Raise) for inner in node.body):
            return
        inner = isinstance(node, ast.FunctionDef | ast.ClassDef)
        if inner:
            self._where.append(node.name)
        if self._where and not inner and changed(node) is not None:
            self.found.append((node, ".".join(self._where)))
        bodies = node.body if inner else ast.iter_child_nodes(node)
        for child in bodies:
            self.visit(child)
        if inner:
            self._where.pop()


def changed(node: ast.AST) -> str | None:
    """What a node becomes, in words, or None where it cannot be changed."""
    if isinstance(node, ast.BinOp | ast.BoolOp) and OTHER.get(type(node.op)):
        return f"{type(node.op).__name__} → {OTHER[type(node.op)].__name__}"
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in OTHER:
        return f"{type(node.ops[0]).__name__} → {OTHER[type(node.ops[0])].__name__}"
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
        return "sign left out"
    if isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value not in (0, 1):
        return f"{node.value} → {other_number(node.value)}"
    return None


def other_number(value: float) -> float:
    """Another one near it."""
    return value + 1 if isinstance(value, int) else 1.3 * value


def mutated(node: ast.AST) -> None:
    """Change it where it stands."""
    if isinstance(node, ast.BinOp | ast.BoolOp):
        node.op = OTHER[type(node.op)]()
    elif isinstance(node, ast.Compare):
        node.ops = [OTHER[type(node.ops[0])]()]
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd()
    elif isinstance(node, ast.Constant):
        node.value = other_number(node.value)


def mutants() -> Iterator[Mutant]:
    """All there are."""
    for package in PACKAGES:
        for path in sorted((ROOT / "ngbrain" / package).rglob("*.py")):
            seen = Changeable()
            seen.visit(ast.parse(path.read_text()))
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            for at, (node, function) in enumerate(seen.found):
                where = f"{module}:{function}"
                yield Mutant(str(path.relative_to(ROOT)), where, node.lineno, at, changed(node) or "")


class Tracer:
    """Pytest plugin: the lines that each test executes, and how long it takes."""

    def __init__(self) -> None:
        import coverage

        self.seconds: dict[str, float] = {}
        self.coverage = coverage.Coverage(
            data_file=None, source=[str(ROOT / "ngbrain" / name) for name in PACKAGES], messages=False
        )

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.coverage.switch_context(item.nodeid)
        return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration


def trace() -> None:
    """Run the fast tests once and save which of them execute which lines."""
    os.chdir(ROOT)
    tracer = Tracer()
    tracer.coverage.start()
    pytest.main(["-q", "-p", "no:cacheprovider", *TESTS], plugins=[tracer])
    tracer.coverage.stop()
    data = tracer.coverage.get_data()
    lines = {}
    for file in data.measured_files():
        contexts = data.contexts_by_lineno(file).items()
        lines[str(Path(file).relative_to(ROOT))] = {str(n): sorted(filter(None, tests)) for n, tests in contexts}
    LINES.parent.mkdir(parents=True, exist_ok=True)
    LINES.write_text(json.dumps({"seconds": tracer.seconds, "lines": lines}))


def tests_of(mutant: Mutant, traced: dict) -> list[str]:
    """Those that execute its line, the quickest first, within `BUDGET_S`."""
    found = traced["lines"].get(mutant.file, {}).get(str(mutant.line), [])
    found = sorted(found, key=lambda test: traced["seconds"].get(test, 1.0))
    total = np.cumsum([traced["seconds"].get(test, 1.0) for test in found])
    return found[: max(1, int(np.searchsorted(total, BUDGET_S)))]


def noticed(mutant: Mutant, tests: list[str], copy: Path) -> str:
    """The first test that fails, "" where none does."""
    path, original = copy / mutant.file, (ROOT / mutant.file).read_text()
    tree = ast.parse(original)
    seen = Changeable()
    seen.visit(tree)
    mutated(seen.found[mutant.at][0])
    path.write_text(ast.unparse(tree))
    plain = ("-o", "addopts=-ra --import-mode=importlib", "-p", "no:cacheprovider")  # a module that fails is no skip
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", *plain, *tests]
    run = subprocess.Popen(
        command,
        cwd=copy,
        env=os.environ | {"PYTHONPATH": str(copy), "OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        printed = run.communicate(timeout=10 * BUDGET_S)[0]
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        run.communicate()
        return "no end"
    finally:
        path.write_text(original)
    if run.returncode == 0:
        return ""
    failed = [line for line in printed.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0].split(" - ")[0] if failed else f"status {run.returncode}"


def main() -> int:
    """See the top."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trace", action="store_true")
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", metavar="FUNCTION")
    parser.add_argument("--list", action="store_true", help="name the functions that have mutants, and how many")
    arguments = parser.parse_args()
    if arguments.trace or not LINES.exists():
        trace()
    traced = json.loads(LINES.read_text())
    every = [(each, tests) for each in mutants() if (tests := tests_of(each, traced))]
    if arguments.list:
        names = [each.function for each, _ in every]
        for name in sorted(set(names)):
            print(names.count(name), name)
        return 0
    if arguments.only:
        drawn = [pair for pair in every if pair[0].function == arguments.only]
    else:
        order = np.random.default_rng(arguments.seed).permutation(len(every))
        drawn = [every[i] for i in order[: arguments.count]]
    survived = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for name in filter(None, listed.split("\0")):
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, copy / name)
        (copy / "ngbrain/meshes").symlink_to("../meshes")
        for mutant, tests in drawn:
            by = noticed(mutant, tests, copy)
            survived += not by
            print(
                f"{'noticed' if by else 'SURVIVED'} | {mutant.function} | line {mutant.line} | {mutant.change} | "
                f"{by or f'{len(tests)} tests'}",
                flush=True,
            )
    print(f"{len(drawn) - survived} of {len(drawn)} noticed")
    return 1 if survived > 0.2 * len(drawn) else 0


if __name__ == "__main__":
    sys.exit(main())
