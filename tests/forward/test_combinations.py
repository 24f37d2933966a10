"""Every ingredient with every controller on every kind of mesh: works, or is refused in one line; the guide's table says which."""

import pytest
from combinations import CONTROLLERS, INGREDIENTS, MESHES, PAGE, WORKS, attempt, outcomes, table

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


@pytest.mark.slow
def test_the_guides_table_is_what_works():
    found = outcomes()
    assert all(found[each] == WORKS for each in NEVER_REFUSED)
    tried = [said for said in found.values() if said != "—"]
    assert sum(said != WORKS for said in tried) <= len(tried) / 5
    assert table(found) in PAGE.read_text()
