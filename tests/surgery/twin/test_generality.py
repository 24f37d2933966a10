"""Nothing in the twin's code is about one organ: what is, is in norm files, scenes and names of data."""

import ast
import re
from pathlib import Path

import pytest

import ngbrain.surgery.twin as package

ORGAN = re.compile(r"brain|grey|gray|white|cort(ex|ical)|ventric|falx|sinus|cereb", re.IGNORECASE)
DATA = {"brain"}
"""The default norm's name."""
FILES = sorted(Path(package.__file__).parent.glob("*.py"))


def words_of_code(path):
    """Names and texts of a module without docstrings and names of its packages."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docs = {
        id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            yield node.value
        elif isinstance(node, ast.Name | ast.Attribute | ast.arg):
            yield getattr(node, "id", None) or getattr(node, "attr", None) or node.arg


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_code_has_no_words_of_one_organ(path):
    found = {word.replace("ngbrain", "") for word in words_of_code(path)}
    assert not {word for word in found if ORGAN.search(word)} - DATA
