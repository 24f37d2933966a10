"""Blades, protocols and measures against values by hand."""

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import unit_cube

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.errors import InputError
from ngbrain.mesh import Cleft
from ngbrain.surgery.measures.injury import Strain, dose
from ngbrain.surgery.protocols import (
    CLEAR,
    ToolMotion,
    continuous_retraction,
    intermittent_retraction,
    staged_retraction,
)
from ngbrain.surgery.tools import Spatula, Tube

CLEFT = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 4e-3, 12e-3)
BLADE = Spatula(CLEFT, 10e-3, 1e-3, 4e-3, 2e-3)
MESH = ngs.Mesh(unit_cube.GenerateMesh(maxh=2.0))


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((7e-3, 0, 15e-3), 4e-3),  # in front of the face, which stands at 2 + 1 mm
        ((2.5e-3, 2e-3, 15e-3), -0.5e-3),  # inside
        ((-50e-3, 0, 15e-3), -5e-3),  # far behind: still inside, nothing slips through
        ((0, 8e-3, 15e-3), 3e-3),  # beside an edge
        ((0, 0, 1e-3), 3e-3),  # below the tip
        ((3e-3, 5e-3, 15e-3), 1e-3 * (np.sqrt(2) - 1)),  # at the rounded edge
    ],
)
def test_distance_to_a_spatula(point, distance):
    phi = BLADE.distance(ngs.CF(1e-3))(ngs.CF(point))
    assert phi(MESH(0.3, 0.3, 0.2)) == pytest.approx(distance, abs=5e-9)


TAPERED = Spatula(CLEFT, 10e-3, 1e-3, 4e-3, 2e-3, tip_width=5e-3)
CURVED = Spatula(CLEFT, 10e-3, 1e-3, 4e-3, 2e-3, bend=40e-3)
TUBE = Tube(CLEFT, 10e-3, 1e-3, 4e-3)
SLOPE = np.hypot(1, 2.5e-3 / 26e-3)


@pytest.mark.parametrize(
    ("blade", "point", "distance"),
    [
        (TAPERED, (7e-3, 0, 15e-3), 4e-3),
        (TAPERED, (0, 8e-3, 30e-3), 3e-3 / SLOPE),  # beside the upper end of an edge, at right angles to it,
        (TAPERED, (0, -8e-3, 17e-3), 4.25e-3 / SLOPE),  # halfway,
        (TAPERED, (0, 2.5e-3, 5e-3), (0 - 2.5e-3 / 26) / SLOPE),  # and just inside at the tip's corner
        (CURVED, (7e-3, 0, 17e-3), 4e-3),  # halfway up, where the face is foremost
        (CURVED, (3e-3, 0, 27e-3), np.hypot(40e-3, 10e-3) - 40e-3),  # where it has bent back
        (TUBE, (0, 7e-3, 15e-3), 4e-3),  # along the walls and across, all around
        (TUBE, (-7e-3, 0, 15e-3), 4e-3),
        (TUBE, (0, 0, 1e-3), 3e-3),  # below
        (TUBE, (1e-3, 0, 15e-3), -2e-3),  # inside
        (TUBE, (0, 4e-3, 3e-3), 1e-3 * (np.hypot(2, 2) - 1)),  # at the rounded rim
    ],
)
def test_distance_to_other_blades(blade, point, distance):
    phi = blade.distance(ngs.CF(1e-3))(ngs.CF(point))
    assert phi(MESH(0.3, 0.3, 0.2)) == pytest.approx(distance, abs=5e-9)


def test_intermittent_covers_the_time_at_the_same_rate_both_ways():
    p = intermittent_retraction(5e-3, 10.0, 900.0, 230.0, 90.0)
    t, s = np.array(p.times), np.array(p.advance)
    rates = np.diff(s) / np.diff(t)
    assert np.allclose(np.abs(rates[rates != 0]), 5e-4)
    assert t[-1] == 900 and p.working_s == pytest.approx(3 * 230)
    assert s.min() == -CLEAR and np.sum(np.diff(s) > 0) == 2 * 3 - 1


def test_continuous_and_staged_end_alike():
    a, b = continuous_retraction(5e-3, 10.0, 900.0), staged_retraction(5e-3, 10.0, 900.0, 5, 30.0)
    assert [a.value(900), b.value(900)] == pytest.approx([5e-3] * 2)
    assert b.value(2.0) == pytest.approx(1e-3) and b.value(30) == pytest.approx(1e-3) and b.times[-1] == 900
    assert a.working_s == 890 and b.working_s == pytest.approx(900 - 10 - 4 * 30)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ToolMotion("p", (0.0, 1.0), (0.0,)),
        lambda: ToolMotion("p", (0.0, 1.0, 1.0), (0.0, 1.0, 2.0)),
        lambda: ToolMotion("p", (1.0, 2.0), (0.0, 1.0)),
        lambda: intermittent_retraction(5e-3, 10.0, 300.0, 100.0, 5.0),
        lambda: intermittent_retraction(5e-3, 10.0, 180.0, 100.0, 80.0),
    ],
)
def test_protocols_that_cannot_be_are_refused(make):
    with pytest.raises(InputError):
        make()


def test_times_above_and_dose():
    t, p = np.array([0, 10, 20, 30, 40, 50.0]), np.array([0, 40, 40, 0, 40, 0.0])
    pressed = TimeCurve(t, p, t)
    assert pressed.above(20) == pytest.approx((30.0, 20.0))
    assert pressed.above(50) == (0.0, 0.0) and pressed.above(40) == (0.0, 0.0)
    assert dose(pressed) == pytest.approx((200 + 400 + 200 + 200 + 200) / 60)
    assert dose(pressed, 15.0) == pytest.approx((200 + 200) / 60)


def test_a_hold_in_few_steps_has_its_dose():
    """A relaxing pressure at eleven times: linear interpolation has an error of .7 %, a spline smooth at the event .15 %."""
    t = np.concatenate([[0, 5], 10 + 600 * np.linspace(0, 1, 9) ** 2])
    p = np.where(t <= 10, 5 * t, 20 + 30 * np.exp(-(t - 10) / 60))
    exact = (250 + 600 * 20 + 30 * 60 * -np.expm1(-10)) / 60
    pressed = TimeCurve(t, p, [0.0, 10.0, 610.0])
    assert dose(pressed) == pytest.approx(exact, rel=1e-3)
    assert abs(dose(TimeCurve(t, p, [0.0, 610.0])) / exact - 1) > 1e-3
    assert abs(np.trapezoid(p, t) / 60 / exact - 1) > 5e-3
    above = 4 + 60 * np.log(3)  # from 30 at 6 s to 20 + 10 at 10 + 60 ln 3
    assert pressed.above(30) == pytest.approx((above, above), rel=0.02)


def test_strain_measures_of_a_known_stretch():
    strain = Strain(np.tile([0.8, 1.0, 1.25], (10, 1)))
    assert strain.mps == pytest.approx(np.full(10, (1.25**2 - 1) / 2))
    e = np.log(1.25)
    assert strain.oss == pytest.approx(np.full(10, 2 / 3 * np.sqrt(6) * e))
    least, most = np.where(np.arange(10) < 4, 0.85, 0.75), np.where(np.arange(10) > 6, 1.2, 1.3)
    assert strain.beyond(least, most).tolist() == [True] * 4 + [False] * 3 + [True] * 3
