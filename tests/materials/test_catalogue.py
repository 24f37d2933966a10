"""Published constants: complete records, moduli from the energies, the curves they were fitted to, warnings."""

import re
import warnings

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import unit_cube

from ngbrain.errors import InputError, RangeWarning
from ngbrain.materials import CATALOGUE, NeoHooke, Ogden, Viscous, catalogue, constants, find_entry
from ngbrain.materials.points import initial_modulus

MESH = ngs.Mesh(unit_cube.GenerateMesh(maxh=2.0))
POINT = MESH(0.3, 0.3, 0.2)

# Averaged curves of Budday 2017, nominal stress in kPa: cortex, corona radiata, basal ganglia, corpus callosum.
REGIONS = ("cortex", "corona_radiata", "basal_ganglia", "corpus_callosum")
COMPRESSION = np.array(
    [
        [0.9000, -1.1484, -0.7591, -0.5528, -0.4555],
        [0.9125, -0.8837, -0.5723, -0.4321, -0.3270],
        [0.9250, -0.6579, -0.4127, -0.3270, -0.2297],
        [0.9375, -0.4866, -0.2959, -0.2414, -0.1596],
        [0.9500, -0.3504, -0.2024, -0.1752, -0.1051],
        [0.9625, -0.2375, -0.1305, -0.1265, -0.0730],
        [0.9750, -0.1479, -0.0800, -0.0778, -0.0427],
        [0.9875, -0.0659, -0.0387, -0.0358, -0.0164],
    ]
)
TENSION = np.array(
    [
        [1.0125, 0.0462, 0.0235, 0.0251, 0.0149],
        [1.0250, 0.0838, 0.0423, 0.0446, 0.0251],
        [1.0375, 0.1175, 0.0572, 0.0619, 0.0337],
        [1.0500, 0.1488, 0.0721, 0.0791, 0.0415],
        [1.0625, 0.1856, 0.0869, 0.0963, 0.0486],
        [1.0750, 0.2366, 0.1050, 0.1151, 0.0580],
        [1.0875, 0.3125, 0.1292, 0.1426, 0.0697],
        [1.1000, 0.4151, 0.1582, 0.1778, 0.0862],
    ]
)
SHEAR = np.array(
    [
        [0.025, 0.0294, 0.0159, 0.0140, 0.0072],
        [0.050, 0.0633, 0.0318, 0.0305, 0.0170],
        [0.075, 0.0983, 0.0488, 0.0488, 0.0319],
        [0.100, 0.1412, 0.0681, 0.0703, 0.0422],
        [0.125, 0.1942, 0.0964, 0.0930, 0.0558],
        [0.150, 0.2698, 0.1347, 0.1257, 0.0751],
        [0.175, 0.3791, 0.1878, 0.1686, 0.1011],
        [0.200, 0.5435, 0.2611, 0.2262, 0.1429],
    ]
)
CURVES = {"compression": COMPRESSION, "tension": TENSION, "shear": SHEAR}


def nominal(law, mode, values):
    """∂W/∂λ (kPa) of an incompressible bar, or ∂W/∂γ of simple shear."""
    x = ngs.Parameter(1.0)
    if mode == "shear":
        C = ngs.CF((1, x, 0, x, 1 + x * x, 0, 0, 0, 1), dims=(3, 3))
    else:
        C = ngs.CF((x * x, 0, 0, 0, 1 / x, 0, 0, 0, 1 / x), dims=(3, 3))
    derivative = law.energy(C).Diff(x)
    stress = []
    for value in values:
        x.Set(value)
        stress.append(derivative(POINT) / 1e3)
    return np.array(stress)


def r_squared(law, mode, region):
    """Of the curve with its start at rest; that of shear goes the same way to the other side."""
    curve = CURVES[mode]
    measured = curve[:, 1 + REGIONS.index(region)]
    misfit = nominal(law, mode, curve[:, 0]) - measured
    mean = 0.0 if mode == "shear" else measured.sum() / (len(measured) + 1)
    spread = np.sum((measured - mean) ** 2) + mean**2
    return 1 - np.sum(misfit**2) / spread


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_entry_says_where_it_comes_from(name):
    entry = CATALOGUE[name]
    assert entry.name == name and re.fullmatch(r"[a-z]+\d{4}(:[a-z_]+)+", name)
    assert re.fullmatch(r"10\.\d{4,}/\S+", entry.doi)
    assert entry.source and entry.species and entry.region and entry.protocol and entry.convention
    least, most = entry.stretch
    assert 0 <= least <= 1 <= most and least < most
    assert entry.evidence in ("source", "transcription", "refit", "recalled")
    assert find_entry(entry.law()) is entry


@pytest.mark.parametrize("name", CATALOGUE)
def test_documented_modulus_is_the_energys(name):
    entry = CATALOGUE[name]
    law = entry.law()
    parts = [law.equilibrium, *(branch.law for branch in law.branches)] if isinstance(law, Viscous) else [law]
    assert sum(map(initial_modulus, parts)) == pytest.approx(entry.initial_modulus, rel=1e-6)
    if entry.bulk is not None and entry.poisson is not None:
        ratio = 2 * (1 + entry.poisson) / (3 * (1 - 2 * entry.poisson))
        assert entry.bulk == pytest.approx(ratio * entry.initial_modulus, rel=1e-9)


def test_franceschini_in_its_own_convention():
    mu, alpha = (1044.0, 1183.0), (4.309, 7.736)
    assert sum(m * a for m, a in zip(mu, alpha, strict=True)) / 2 == pytest.approx(6.825e3, rel=1e-4)
    own = sum(m * 1.2 ** (a - 1) - m * 1.2 ** (-a / 2 - 1) for m, a in zip(mu, alpha, strict=True)) / 1e3
    assert nominal(constants("franceschini2006:brain").law(), "tension", [1.2])[0] == pytest.approx(own, rel=1e-8)


def test_miller_instantaneous_and_long_term():
    for name in ("miller1997:brain", "miller2002:brain"):
        entry = constants(name)
        assert initial_modulus(entry.law().equilibrium) == pytest.approx(0.185 * entry.initial_modulus, rel=1e-6)
        assert [branch.tau for branch in entry.law().branches] == [0.5, 50.0]


@pytest.mark.parametrize(
    ("region", "wanted"),
    [  # of all 33 points of each curve; the tables above are every second one
        ("cortex", (0.996, 0.922, 0.992)),
        ("corona_radiata", (0.941, 0.987, 0.993)),
        ("basal_ganglia", (0.982, 0.974, 0.995)),
        ("corpus_callosum", (0.919, 0.990, 0.992)),
    ],
)
def test_simultaneous_fits_follow_all_three_curves(region, wanted):
    law = constants(f"budday2017:{region}").law()
    for mode, quality in zip(CURVES, wanted, strict=True):
        assert r_squared(law, mode, region) == pytest.approx(quality, abs=0.01), mode


@pytest.mark.parametrize("mode", ["compression", "tension"])
@pytest.mark.parametrize("region", REGIONS)
def test_fits_of_one_mode_follow_its_curve(region, mode):
    for kind, least in {"ogden": 0.99, "demiray": 0.98, "gent": 0.98, "neohooke": 0.86}.items():
        law = constants(f"budday2017:{region}:{kind}:{mode}").law()
        assert r_squared(law, mode, region) > least, kind


# What is met.


@pytest.fixture
def unwarned(monkeypatch):
    monkeypatch.setattr(catalogue, "_warned", set())


def test_warns_once_beyond_the_data(unwarned):
    entry = constants("miller1997:brain")
    with pytest.warns(RangeWarning) as caught:
        entry.check(0.7, 1.0)
        entry.check(0.65, 1.02)
        entry.check(0.5, 1.5)
    (warning,) = caught
    assert str(warning.message) == "miller1997:brain has data for stretches 0.7 to 1; met: 0.65 to 1.02"
    with pytest.warns(RangeWarning, match="budday2017:cortex has data for stretches 0.9 to 1.1"):
        constants("budday2017:cortex").check(1.0, 1.11)
    with pytest.warns(RangeWarning, match="griffiths2024:cortex .*; met: 0.85 to 1"):
        constants("griffiths2024:cortex").check(0.85, 1.0)


def test_is_silent_within_the_data(unwarned):
    with warnings.catch_warnings(action="error"):
        constants("budday2017:cortex").check(0.9, 1.1)
        constants("budday2017:cortex:gent:tension").check(1.0, 1.1 + 1e-12)
        constants("wittek2007:csf").check(0.1, 7.0)


# By name, and back.


def test_griffiths_cortex():
    cortex = constants("griffiths2024:cortex")
    law = cortex.law()
    assert law.equilibrium == Ogden(420.0, -21.27)
    assert [(b.law.mu, b.law.alpha, b.eta) for b in law.maxwell_branches] == [
        (1400.0, -14.66, 3050.0),
        (560.0, -23.76, 289370.0),
    ]
    assert cortex.initial_modulus == 2380.0 and cortex.fitted_strain == 0.1


def test_law_is_found_again_unless_changed():
    assert find_entry(Ogden(1442.0, -19.2)).name == "budday2017:cortex"
    assert find_entry(Ogden(1442.0, -19.0)) is None and find_entry(NeoHooke(ngs.Parameter(290.0))) is None


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("miler2002:brain", "such as 'miller2002:brain'"),
        ("cortx", "such as 'griffiths2024:cortex'"),
        ("budday2017:cortex:gent", "such as 'budday2017:cortex:gent:"),
        ("steel", "a name in the catalogue; `ngbrain materials` lists all"),
    ],
)
def test_unknown_name_is_answered_with_the_nearest(name, hint):
    with pytest.raises(InputError, match=f"constants is '{name}'; wanted: .*{hint}"):
        constants(name)


def test_samples_widen_where_they_are_pressed():
    assert constants("budday2017:cortex").principal_stretch == (0.9, 1.1)
    least, most = constants("budday2017:cortex:gent:tension").principal_stretch
    assert (least, most) == (pytest.approx(1.1**-0.5), 1.1)
    assert constants("wittek2007:csf").principal_stretch == (0.0, np.inf)


def test_cautions_are_of_what_was_measured():
    assert not constants("griffiths2024:cortex").cautions
    assert constants("budday2017:cortex:gent:tension").cautions == [
        "the energy is undefined beyond I₁ = 3.08",
        "measured in tension alone",
    ]
    assert "for small strain" in constants("bennion2022:pia").cautions[0]
