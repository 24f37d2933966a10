"""Names that a newcomer can guess: plain English or terms of the glossary, each class once, folders of a size to look over."""

import ast
import re
from collections import Counter, defaultdict
from pathlib import Path

import pytest

import ngbrain

PACKAGE = Path(ngbrain.__file__).parent
GLOSSARY = Path(__file__).parents[1] / "tutorials" / "guide" / "reference" / "glossary.md"
PLAIN = Path(__file__).with_name("plain_words.txt")
MODULES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py"))}
PACKAGES = sorted(path.parent for path in MODULES if path.name == "__init__.py")
LARGEST = 14


def words(name):
    """A name split at underscores and capitals, in small letters."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def public(body):
    return [n for n in body if isinstance(n, ast.FunctionDef | ast.ClassDef) and not n.name.startswith("_")]


def names():
    """Public name → where it is, of modules, classes, functions and methods."""
    for path, tree in MODULES.items():
        yield path.stem.strip("_"), path
        for node in public(tree.body):
            yield node.name, path
            if isinstance(node, ast.ClassDef):
                yield from ((method.name, path) for method in public(node.body))


def test_words_of_names_are_plain_or_in_the_glossary():
    known = set(words(GLOSSARY.read_text(encoding="utf-8"))) | set(PLAIN.read_text(encoding="utf-8").split())
    unknown = {f"{name} ({path.relative_to(PACKAGE)})" for name, path in names() if set(words(name)) - known}
    assert not unknown, "reword them, or add a line to the glossary"


def test_plain_words_are_used():
    used = {word for name, _ in names() for word in words(name)}
    assert not set(PLAIN.read_text(encoding="utf-8").split()) - used


def test_a_class_name_exists_once():
    where = defaultdict(list)
    for path, tree in MODULES.items():
        for node in public(tree.body):
            if isinstance(node, ast.ClassDef):
                where[node.name].append(path.relative_to(PACKAGE).as_posix())
    assert not {name: files for name, files in where.items() if len(files) > 1}


def test_a_folder_is_small_enough_to_look_over():
    counts = Counter(path.parent for path in MODULES if path.name != "__init__.py")
    assert not {folder.relative_to(PACKAGE).as_posix(): n for folder, n in counts.items() if n > LARGEST}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_a_package_says_what_it_holds(package):
    tree = MODULES[package / "__init__.py"]
    assigned = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    assert ast.get_docstring(tree) and "__all__" in assigned
