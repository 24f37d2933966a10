"""Derivatives by every parameter of every term: Taylor rates, or refused in one line; the guide's table says which."""

import numpy as np
import pytest
from derivatives import COLUMNS, MESHES, PAGE, ROWS, WORKS, Scene, attempt, outcomes, rates_of, table

from ngbrain.forward.sensitivity.contact_work import ContactForms

FAST = [
    ("tissue", "bulk modulus"), ("follower pressure", "value"), ("cavity of given volume", "volume"), ("friction", "slip"),
    ("inertia", "density"), ("tool of given force", "force"), ("supports", "prescribed value"), ("mesh", "node positions"),
]  # fmt: skip
REFUSED = {
    ("walls that close", "penalty"): COLUMNS,
    ("mesh", "node positions"): ("run", "run, twice"),
}
"""Rows and columns that may be refused; all others never are."""


def judged(row, column, said):
    assert "\n" not in said
    assert said in (WORKS, "—") or column in REFUSED.get(row, ()), (row, column, said)


@pytest.mark.parametrize("row", FAST, ids=", ".join)
def test_a_parameter_of_a_term(row):
    for column in COLUMNS:
        judged(row, column, attempt("plane strain, triangles", *row, column))


def test_a_bug_is_no_derivative(monkeypatch):
    slopes = ContactForms.parameter_gradient
    monkeypatch.setattr(ContactForms, "parameter_gradient", lambda self: 1.001 * slopes(self))
    scene = Scene("plane strain, triangles", "springs", "stiffness", running=True)
    assert not np.any(np.abs(rates_of(scene.models(), twice=False)[1:] - 2) < 0.1)


@pytest.mark.slow
def test_the_guides_table_of_derivatives_is_what_works():
    found = outcomes()
    for (*row, column, _), said in found.items():
        judged(tuple(row), column, said)
    assert {kind for *_, kind in found} == set(MESHES) and {tuple(row[:2]) for row in found} == set(ROWS)
    assert table(found) in PAGE.read_text()
