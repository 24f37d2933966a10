"""Structures in the corridor that no mesh contains."""

import numpy as np
import pytest

from ngbrain.errors import ImplausibleWarning
from ngbrain.mesh import cleft_to
from ngbrain.surgery import corridor
from ngbrain.surgery.corridor import check_corridor, crossings


class Model:
    """The part of a model that the check uses."""

    def __init__(self, target, approach=None, head="idealised"):
        self.cleft = cleft_to(np.array(target), approach=approach)
        self.head, self.scene = object(), type("S", (), {"geometry": type("G", (), {"kind": head})})


def test_a_target_on_the_mid_plane_is_not_taken_without_a_word():
    with pytest.warns(ImplausibleWarning, match="crosses the mid plane.*falx.*sagittal sinus.*part of the model"):
        (said,) = check_corridor(Model((0.0, 0.0, 0.03)))
    assert said.count("\n") == 0


def test_a_corridor_through_one_hemisphere_is():
    assert check_corridor(Model((0.03, 0.0, 0.03))) == []


def test_the_far_hemisphere_is_reached_through_the_falx():
    across = crossings(cleft_to(np.array([-0.02, 0, 0.02]), approach=np.array([1.0, 0, 0.5])))
    assert across == ["crosses the mid plane, where the falx stands"]


def test_the_middle_of_a_scan_is_its_brains():
    model = Model((0.03, 0.0, 0.03), head="scan")
    model.head = type("H", (), {"extent": lambda self: (np.array([0.03, 0, 0]), np.ones(3))})()
    assert corridor._middle(model) == 0.03
    with pytest.warns(ImplausibleWarning):
        assert check_corridor(model)
