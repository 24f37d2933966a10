"""Quasi-static axial displacement of a compressed window with unknown boundary tractions: contrast of a lesion, and notes."""

from dataclasses import replace

import numpy as np
import pytest
from compressed_lesion import CONTRAST, ball, compression, contrast, plane

from ngbrain.inverse.data.ultrasound import BALL, is_tracked, minimum_model_error
from ngbrain.inverse.elastography.invert import invert


@pytest.fixture(scope="module")
def pressed():
    return compression(plane)


def test_a_cylinder_of_three_times_the_stiffness(pressed):
    found = invert(pressed, uniform=False)
    lesion, uneven = contrast(pressed.points, found.maps["youngs"])
    assert lesion == pytest.approx(CONTRAST, rel=0.15) and uneven < 0.15
    assert found.usable and found.checks["converged"] and found.regulariser == "steps"
    said = " ".join(found.warnings)
    assert all(words in said for words in ("right up to one common factor", "is the regulariser's choice", "ball"))


@pytest.mark.slow
def test_a_ball_reads_low_as_is_said():
    data = compression(ball)
    lesion, uneven = contrast(data.points, invert(data, uniform=False).maps["youngs"])
    assert lesion < 0.85 * CONTRAST and 1 + BALL * (lesion - 1) == pytest.approx(CONTRAST, rel=0.15) and uneven < 0.2


def test_rigid_motion_is_no_reason_for_larger_errors(pressed):
    moved = pressed.displacement.copy()
    moved[:, :, 1] += 1e-3 - 0.02 * pressed.points[:, 0]
    far = replace(pressed, displacement=moved)
    absolute = [minimum_model_error(data) * data.rms[0, 0, 1] for data in (pressed, far)]
    assert absolute[1] == pytest.approx(absolute[0], rel=1e-6)


def test_what_is_tracked(pressed):
    both = np.where(np.isnan(pressed.displacement), 1e-5, pressed.displacement)
    assert is_tracked(pressed)
    assert not is_tracked(replace(pressed, displacement=both)) and not is_tracked(replace(pressed, frequency=[50.0]))
