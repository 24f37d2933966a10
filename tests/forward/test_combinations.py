"""Every ingredient with every controller on every kind of mesh: works, or is refused in one line; the guide's table says which."""

import pytest
from combinations import CONTROLLERS, INGREDIENTS, MESHES, PAGE, WORKS, attempt, outcomes, pairs, table, together

NEVER_REFUSED = [
    *[
        (each, "moving tool", kind)
        for each in ("contact by penalty", "contact with offset", "friction")
        for kind in MESHES
    ],
    *[("tool of given force", "moving tool", kind) for kind in MESHES],
    *[("walls that close", "moving tool", kind) for kind in MESHES],
]


@pytest.mark.parametrize("kind", ["plane strain, triangles", "axisymmetric, quadrilaterals", "space, hexahedra"])
@pytest.mark.parametrize("ingredient", INGREDIENTS)
def test_an_ingredient_works_or_is_refused_in_one_line(ingredient, kind):
    for controller in CONTROLLERS:
        said = attempt(kind, ingredient, controller)
        assert "\n" not in said
        assert said == WORKS or (ingredient, controller, kind) not in NEVER_REFUSED, (controller, said)


ALWAYS_TOGETHER = [
    ("friction", "tool of given force"), ("walls that close", "hereditary branches"), ("walls that close", "Maxwell branches"),
    ("friction", "inertia"), ("friction", "Maxwell branches"), ("contact with offset", "friction"),
    ("inertia", "tool of given force"), ("cavity of given volume", "contact with offset"),
]  # fmt: skip


@pytest.mark.parametrize("ingredient", INGREDIENTS)
def test_two_ingredients_work_together_or_are_refused_in_one_line(ingredient):
    for other in INGREDIENTS[INGREDIENTS.index(ingredient) :]:
        said = together("plane strain, triangles", ingredient, other)
        assert "\n" not in said
        assert said == WORKS or not {(ingredient, other), (other, ingredient)} & set(ALWAYS_TOGETHER), (other, said)


@pytest.mark.slow
def test_the_guides_table_is_what_works():
    found = outcomes()
    assert all(found[each] == WORKS for each in NEVER_REFUSED)
    tried = [said for said in found.values() if said != "—"]
    assert sum(said != WORKS for said in tried) <= len(tried) / 5
    assert table(found) in PAGE.read_text()


@pytest.mark.slow
def test_the_guides_table_of_pairs_is_what_works():
    found = pairs()
    assert all(found[one, other, kind] in (WORKS, "—") for one, other in ALWAYS_TOGETHER for kind in MESHES)
    tried = [said for said in found.values() if said != "—"]
    assert sum(said != WORKS for said in tried) <= len(tried) / 5
    assert table(found, INGREDIENTS) in PAGE.read_text()
