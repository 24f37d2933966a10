"""Material parameters from specimens glued to their plates: against closed-form limits, other elements and known truths."""

import numpy as np
import pytest

from ngbrain.adjoint import check
from ngbrain.errors import InputError
from ngbrain.inverse.fitting.bonded_specimen import BondedFit, BondedSpecimen, _levels
from ngbrain.materials import Maxwell, NeoHooke, Ogden, Viscous, lab

CORTEX = Ogden(1442.0, -19.2)
COARSE = BondedSpecimen(maxh=0.0025, levels=3)


def test_a_cube_resists_more_when_pressed_and_less_when_sheared():
    """Small strain, incompressible: 1.245 of 3μ and .743 of μ (P4/P3, 1.25 mm)."""
    law, cube = NeoHooke(1000.0), BondedSpecimen(levels=1)
    assert cube.stress(law, "uniaxial", [0.999])[0] / -3.0 == pytest.approx(1.245, rel=0.014)
    assert cube.stress(law, "shear", [0.001])[0] == pytest.approx(0.743, rel=0.014)


def test_a_long_bar_is_homogeneous_but_for_its_ends():
    def excess(length):
        bar = BondedSpecimen((0.005, 0.005, length), form="P2/P1", levels=1)
        return float(bar.stress(CORTEX, "uniaxial", [1.05])[0] / lab.stress(CORTEX, "uniaxial", [1.05])[0] - 1)

    short, long = excess(0.02), excess(0.04)
    assert 0 < long < 0.04
    assert short / long == pytest.approx(2, rel=0.2)  # two ends of the same share


def test_between_levels_a_curve_is_a_polynomial_through_rest():
    strains = np.array([-0.1, 0.0, 0.02, 0.05, 0.1, 0.13, 0.2, 0.2])
    at, matrix = _levels(strains, 3)
    assert at == pytest.approx([-0.1, 0.05, 0.15, 0.2])
    for power in (1, 2, 3):
        assert matrix[2:, 1:] @ at[1:] ** power == pytest.approx(strains[2:] ** power)
    assert matrix[1] == pytest.approx(np.zeros(4)) and matrix[0] == pytest.approx([1, 0, 0, 0])


def test_levels_lose_little():
    where = np.linspace(0.9, 1.1, 17)
    few, many = (BondedSpecimen(form="P2/P1", maxh=0.005, levels=n).stress(CORTEX, "uniaxial", where) for n in (5, 16))
    assert np.abs(few - many).max() < 5e-4 * np.abs(many).max()


def test_the_misfits_slope_is_theirs():
    problem = BondedFit(
        BondedSpecimen(form="P2/P1", maxh=0.005, levels=3),
        Ogden,
        [c for c in lab.budday("cortex") if c.name != "shear"],
        {"mu": 1e3, "alpha": -9.0},
        {},
        {},
    )
    at, along = np.array([1e3, -9.0]), np.array([1e3, 6.0])
    rates = check.taylor(problem.misfits, lambda dx: problem.gradient(at) @ dx, at, along, first=0.05)
    assert np.all(np.abs(rates - 2) < 0.1), rates


@pytest.fixture(scope="module")
def measured():
    """Curves of cubes with the cortex's law in other elements, with 1 % noise."""
    random, cube, curves = np.random.default_rng(3), BondedSpecimen(maxh=0.0025, form="P4/P3", levels=4), []
    for name, mode, where in (
        ("compression", "uniaxial", np.linspace(1, 0.9, 9)),
        ("tension", "uniaxial", np.linspace(1, 1.1, 9)),
        ("shear", "shear", np.linspace(0, 0.2, 9)),
    ):
        stress = cube.stress(CORTEX, mode, where)
        curves.append(lab.Curve(mode, where, stress + 0.01 * np.abs(stress).max() * random.normal(size=9), name))
    return curves


def test_known_constants_come_back(measured):
    found = COARSE.fit(Ogden, measured, {"mu": 700.0, "alpha": -10.0})
    print(found)
    assert found.parameters["mu"] == pytest.approx(1442.0, rel=0.04)  # of which the mesh is 2 %
    assert found.parameters["alpha"] == pytest.approx(-19.2, rel=0.04)
    assert min(found.r2.values()) > 0.99 and found.law.mu == found.parameters["mu"]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: BondedSpecimen((0.005, 0.0, 0.005)), "three lengths"),
        (lambda: BondedSpecimen(levels=0), "at least 1"),
        (lambda: COARSE.stress(CORTEX, "planar", [1.1]), "uniaxial or shear"),
        (
            lambda: COARSE.fit(NeoHooke, [lab.Curve("shear", [0.0, 0.1], [0.0, 1.0], times=[0, 1])], {"mu": 1e3}),
            "without times",
        ),
        (lambda: COARSE.fit(NeoHooke, [lab.Curve("shear", [0.0, 0.0], [0.0, 1.0])], {"mu": 1e3}), "some that deform"),
        (
            lambda: COARSE.fit(
                lambda mu: Viscous(NeoHooke(mu), (Maxwell(NeoHooke(mu), eta=1.0),)),
                [lab.Curve("shear", [0.1, 0.2], [0.0, 1.0])],
                {"mu": 1e3},
            ),
            "an elastic one",
        ),
    ],
)
def test_what_is_refused(call, said):
    with pytest.raises(InputError, match=said):
        call()
