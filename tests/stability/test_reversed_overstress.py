"""Tissue held far from rest and let go. Naive: hereditary branches, whose reversed overstress is a dead load, so that the
stress falls on the way and tissue snaps from one shape to another. Ours: Maxwell branches, which unload along a spring."""

import numpy as np
import pytest

from ngbrain.materials import Branch, Viscous, constants, lab

pytestmark = pytest.mark.filterwarnings("ignore::ngbrain.errors.RangeWarning")

FLOWING = constants("griffiths2024:white_matter").law()
HEREDITARY = Viscous(FLOWING.equilibrium, tuple(Branch(branch.law, branch.tau) for branch in FLOWING.branches))


def smallest_slope(material, pressed):
    """Smallest dP/dλ (Pa) of an unloading in 10 ms, after 10 s of equibiaxial pressing and 200 s of rest."""
    unload = np.linspace(pressed, 1.05, 201)
    times = [np.linspace(0, 10, 21), 10 + np.geomspace(0.5, 200, 30), 210 + np.linspace(0, 0.01, 201)[1:]]
    stretches = [np.linspace(1, pressed, 21), np.full(30, pressed), unload[1:]]
    stress = lab.history(material, "equibiaxial", np.concatenate(times), np.concatenate(stretches))
    return np.min(np.diff(stress[50:]) / np.diff(unload))


@pytest.mark.parametrize(("pressed", "naive", "ours"), [(0.85, -500, 3e4), (0.8, -2000, 3e4)])
def test_unloading_goes_through_a_limit_point_only_with_hereditary_branches(pressed, naive, ours):
    assert smallest_slope(HEREDITARY, pressed) < naive
    assert smallest_slope(FLOWING, pressed) > ours
