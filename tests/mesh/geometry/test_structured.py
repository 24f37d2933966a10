"""Hexahedra and quadrilaterals of chosen cells."""

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.mesh.geometry.structured import boxes, rectangles

PLANES = np.array([0.0, 1.0, 3.0, 4.0]), np.arange(3.0), np.arange(3.0)


def test_volume_and_surface_of_what_was_chosen():
    cells = np.ones((3, 2, 2), bool)
    cells[1, 0, 0] = False  # 2 × 1 × 1
    mesh = boxes(cells, *PLANES)
    assert ngs.Integrate(1, mesh) == pytest.approx(16 - 2)
    assert ngs.Integrate(1, mesh, ngs.BND) == pytest.approx(
        2 * (4 + 8 + 8) + 2
    )  # two walls of 1 m² more than were taken


def test_a_hollow_has_a_wall_of_its_own():
    cells = np.ones((3, 3, 3), bool)
    cells[1, 1, 1] = False
    mesh = boxes(cells, *[np.arange(4.0)] * 3)
    assert ngs.Integrate(1, mesh, ngs.BND) == pytest.approx(54 + 6)
    normal = ngs.specialcf.normal(3)
    outward = ngs.Integrate((ngs.CF((ngs.x, ngs.y, ngs.z)) * normal), mesh, ngs.BND)
    assert outward == pytest.approx(3 * 26)  # Gauss: all sides look outward


@pytest.mark.parametrize(
    "cells, planes, words",
    [
        (np.ones((3, 2, 2), bool), (PLANES[0][::-1], *PLANES[1:]), "boxes.x"),
        (np.ones((2, 2, 2), bool), PLANES, "cells"),
        (np.zeros((3, 2, 2), bool), PLANES, "0 of"),
    ],
)
def test_bad_input(cells, planes, words):
    with pytest.raises(InputError, match=words):
        boxes(cells, *planes)


def test_quadrilaterals_of_what_was_chosen():
    cells = np.ones((3, 3), bool)
    cells[1, 1] = cells[2, 0] = False  # a hole and a corner
    mesh = rectangles(np.arange(4.0), 2 * np.arange(4.0), cells)
    assert mesh.ne == 7 and set(mesh.GetBoundaries()) == {"hull"}
    assert ngs.Integrate(1, mesh) == pytest.approx(14)
    assert ngs.Integrate(1, mesh, ngs.BND) == pytest.approx(18 + 6)
    normal = ngs.specialcf.normal(2)
    assert ngs.Integrate(ngs.CF((ngs.x, ngs.y)) * normal, mesh, ngs.BND) == pytest.approx(2 * 14)  # sides look outward
    with pytest.raises(InputError, match=r"rectangles\.cells"):
        rectangles(np.arange(4.0), np.arange(4.0), cells[:2])
