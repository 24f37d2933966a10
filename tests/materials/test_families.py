"""Laws with moduli times a factor, several laws as one, several tissues side by side: each against its own energy."""

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import unit_cube

from ngbrain.errors import InputError
from ngbrain.materials import (
    CATALOGUE,
    Branch,
    Deformation,
    Demiray,
    Fung,
    Gent,
    Guccione,
    HolzapfelGasserOgden,
    Maxwell,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    Polynomial,
    Prony,
    RelaxingOgden,
    Scaled,
    UnsplitNeoHooke,
    Viscous,
    Yeoh,
    density,
    mix,
)
from ngbrain.materials.base import density_of_log_strains
from ngbrain.materials.families import (
    FAMILIES,
    Piecewise,
    group_by_family,
    hereditary_form,
    instantaneous_law,
    is_neo_hooke,
    law_after,
    merge,
    relaxation_time,
    scale,
    shear_modulus,
    stiffen,
)
from ngbrain.materials.points import initial_modulus
from ngbrain.materials.viscous import viscous

MESH = ngs.Mesh(unit_cube.GenerateMesh(maxh=0.5))
PLACES = MESH([0.1, 0.8], [0.3, 0.4], [0.2, 0.3])
LEFT = ngs.IfPos(0.5 - ngs.x, 1.0, 0.0)
STRETCH = np.eye(3) + 0.03 * np.array([[1.0, 0.5, -0.2], [0.3, -0.8, 0.4], [-0.6, 0.1, 0.5]])
AXIS = (1.0, 2.0, 0.0)
LAWS = [
    NeoHooke(300.0),
    UnsplitNeoHooke(300.0),
    MooneyRivlin(200.0, 100.0),
    Polynomial({(1, 0): 263.0, (0, 1): 263.0, (2, 0): 491.0}),
    Yeoh(150.0, 40.0),
    Gent(2010.0, 0.08),
    Demiray(1900.0, 18.8),
    Ogden([420.0, 30.0], [-21.0, 4.0]),
    HolzapfelGasserOgden(500.0, 2000.0, 5.0, 0.1, AXIS),
    Fung(100.0, np.diag([20.0, 20.0, 20.0, 10.0, 10.0, 10.0])),
    Guccione(2000.0, 8.0, 2.0, 4.0, AXIS),
    NeoHooke(100.0) + Gent(50.0, 0.2),
    Scaled(Demiray(1900.0, 18.8), 0.3),
]
PARTS = [
    ([NeoHooke(100.0), Ogden(50.0, -20.0), NeoHooke(10.0), Ogden(5.0, -20.0)], 1),
    ([Scaled(Polynomial({(1, 0): 30.0, (2, 0): 7.0}), 0.4), Polynomial({(1, 0): 3.0, (0, 1): 8.0})], 1),
    ([Gent(100.0, 0.1), Scaled(Gent(70.0, 0.1), 0.2), Gent(40.0, 0.2), Demiray(30.0, 2.0)], 3),
]


def energy(law, F=STRETCH):
    """Energies (Pa) at both places."""
    return np.array(density(law, Deformation.from_gradient(ngs.CF(tuple(np.ravel(F)), dims=(3, 3))))(PLACES)).ravel()


def energies(material, F=STRETCH):
    """Of what stays, and of each branch."""
    return [energy(law, F) for law in (material.equilibrium, *(branch.law for branch in material.branches))]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_law_times_a_factor_has_its_energy_times_the_factor(law):
    field = 2.0 - ngs.x
    assert energy(scale(law, 2.5)) == pytest.approx(2.5 * energy(law), rel=1e-12)
    assert energy(scale(law, field)) == pytest.approx(np.array([1.9, 1.2]) * energy(law), rel=1e-12)
    assert shear_modulus(scale(law, 2.5)) == pytest.approx(2.5 * initial_modulus(law), rel=1e-9)


@pytest.mark.parametrize("name", CATALOGUE)
def test_moduli_by_constants_are_those_of_the_energy(name):
    law = viscous(CATALOGUE[name].law())
    for part in (law.equilibrium, *(branch.law for branch in law.branches)):
        assert shear_modulus(part) == pytest.approx(initial_modulus(part), rel=1e-8)
    for branch in law.branches:
        assert relaxation_time(branch) == pytest.approx(branch.tau, rel=1e-8)


@pytest.mark.parametrize(("laws", "count"), PARTS, ids=["ogden", "polynomial", "several"])
def test_a_sum_of_laws_is_as_few_energies(laws, count):
    one = merge(laws)
    assert energy(one) == pytest.approx(sum(energy(law) for law in laws), rel=1e-12)
    assert len(getattr(one, "parts", [one])) == count


def test_laws_made_of_others_say_their_energy_at_logarithmic_strains():
    """As at the tensor of these, and by Ogden's own formula where there is a part of his: no search for eigenvalues."""
    logs = [ngs.CF(0.03), ngs.CF(-0.05), ngs.CF(0.02)]
    C = ngs.CF(tuple(np.diag(np.exp(2 * np.array([0.03, -0.05, 0.02]))).ravel()), dims=(3, 3))
    ogden, gent = Ogden(900.0, -19.0), Gent(500.0, 1.0)
    for law in (ogden, gent, Scaled(ogden, 0.3), ogden + gent, Piecewise(((ogden, LEFT), (gent, 1 - LEFT)))):
        found, wanted = density_of_log_strains(law, logs)(PLACES), density(law, Deformation.from_stretch(C))(PLACES)
        assert found == pytest.approx(wanted, rel=1e-6)
        assert (np.ptp(found) > 0) == isinstance(law, Piecewise)
        assert "acos" not in str(density_of_log_strains(law, logs))
    assert "acos" in str(density(ogden, Deformation.from_stretch(C)))


def test_stiffer_tissue_relaxes_as_quickly():
    for material in (RelaxingOgden([160.0, 970.0], [-25.0, -24.0], eta=[2190.0]), Prony(Gent(1e3, 0.1), [0.5], [3.0])):
        stiff = stiffen(material, 3.0)
        assert [e[0] for e in energies(stiff)] == pytest.approx([3 * e[0] for e in energies(material)], rel=1e-12)
        assert [b.tau for b in stiff.branches] == pytest.approx([b.tau for b in material.branches], rel=1e-8)


def test_what_is_left_after_a_time():
    mu, alpha, eta = (160.0, 970.0, 250.0), (-25.0, -24.0, -23.0), (2190.0, 3e5)
    tissue = RelaxingOgden(mu, alpha, eta)
    assert tissue == Viscous(
        Ogden(160.0, -25.0), (Maxwell(Ogden(970.0, -24.0), 2190.0), Maxwell(Ogden(250.0, -23.0), 3e5))
    )
    assert law_after(tissue, 1e-9).mu == pytest.approx(mu) and law_after(tissue, 1e12).mu[1:] == pytest.approx(
        (0, 0), abs=1e-3
    )
    left = law_after(tissue, 2190.0 / 970.0)
    assert left.mu[1] == pytest.approx(970.0 * (1 - np.exp(-1))) and left.alpha == alpha
    assert instantaneous_law(tissue) == Ogden(mu, alpha)
    assert hereditary_form(tissue).branches[1] == Branch(Ogden(250.0, -23.0), 1200.0)
    whole = Gent(1e3, 0.1)
    relaxing = Prony(whole, [0.45, 0.365], [0.5, 50.0])
    assert shear_modulus(law_after(relaxing, 0.5)) == pytest.approx(
        1e3 * (0.185 + 0.45 * (1 - np.exp(-1)) + 0.365 * -np.expm1(-0.01) / 0.01)
    )
    assert energy(instantaneous_law(relaxing)) == pytest.approx(energy(whole), rel=1e-12)
    assert isinstance(instantaneous_law(relaxing), Gent)


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"mu": [1.0, 2.0], "alpha": [3.0]}, "alpha"),
        ({"mu": [1.0, 2.0], "eta": [3.0], "tau": [3.0]}, "tau"),
        ({"mu": [1.0, 2.0], "eta": [3.0, 4.0]}, "eta"),
    ],
)
def test_relaxing_ogden_refuses_what_does_not_fit(given, field):
    with pytest.raises(InputError, match=f"RelaxingOgden.{field}"):
        RelaxingOgden(**given)


def test_relaxing_ogden_is_hereditary_by_times_and_neo_hooke_without_exponents():
    law = RelaxingOgden([100.0, 50.0], tau=[2.0])
    assert law == Viscous(NeoHooke(100.0), (Branch(NeoHooke(50.0), 2.0),)) and is_neo_hooke(law)
    assert not is_neo_hooke(RelaxingOgden([100.0, 50.0], [2.0, -4.0], tau=[2.0]))


# Tissues side by side.

KINDS = {
    "neo-hooke": NeoHooke(800.0),
    "ogden": Ogden([420.0, 100.0], [-21.27, 3.0]),
    "demiray": Demiray(1900.0, 18.8),
    "demiray, softer": Demiray(500.0, 4.0),
    "gent": Gent(2010.0, 0.08),
    "polynomial": Polynomial({(1, 0): -101.0, (0, 1): 149.0, (1, 1): 19.0}),
    "polynomial, other powers": Polynomial({(1, 0): 263.0, (2, 0): 491.0}),
    "fibres": HolzapfelGasserOgden(500.0, 2000.0, 5.0, 0.1, AXIS),
    "fibres, another way": HolzapfelGasserOgden(500.0, 2000.0, 5.0, 0.1, (0.0, 0.0, 1.0)),
    "maxwell": RelaxingOgden([420.0, 1400.0, 560.0], [-21.27, -14.66, -23.76], eta=[3050.0, 289370.0]),
    "one maxwell": RelaxingOgden([160.0, 970.0], [-25.66, -25.35], eta=[2190.0]),
    "prony of ogden": Prony(Ogden(842.0, -4.7), [0.45, 0.365], [0.5, 50.0]),
    "prony of gent": Prony(Gent(2010.0, 0.08), [0.3], [5.0]),
    "prony of a polynomial": Prony(Polynomial({(1, 0): 263.0, (2, 0): 491.0}), [0.45], [0.5]),
}


def slopes(law, F):
    """∂W/∂F at both places."""
    variable = ngs.CF(tuple(np.ravel(F)), dims=(3, 3)).MakeVariable()
    return np.array(density(law, Deformation.from_gradient(variable)).Diff(variable)(PLACES))


NAMES = list(KINDS)


@pytest.mark.parametrize(
    ("left", "right"), [(NAMES[i], NAMES[i - shift]) for i in range(len(NAMES)) for shift in (0, 1, 4)]
)
def test_each_tissue_has_its_own_energy_where_it_is(left, right):
    """Also at a stretch beyond which Gent's law has no energy, where the other one is."""
    kinds = [viscous(KINDS[name]) for name in (left, right)]
    both = mix([(kinds[0], LEFT), (kinds[1], 1 - LEFT)])
    far = np.diag([1.5, 1 / 1.5, 1.0])
    for F in (STRETCH, far):
        for place, kind in enumerate(kinds):
            wanted = slopes(kind.equilibrium, F)[place]
            assert np.allclose(slopes(both.equilibrium, F)[place], wanted, rtol=1e-10, atol=1e-9, equal_nan=True)
            for k, branch in enumerate(both.maxwell_branches):
                own = kind.maxwell_branches[k] if k < len(kind.maxwell_branches) else None
                _same(branch, own, "eta", place, F)
            for k, branch in enumerate(both.hereditary_branches):
                own = kind.hereditary_branches[k] if k < len(kind.hereditary_branches) else None
                _same(branch, own, "tau", place, F)
    assert len(both.maxwell_branches) == max(len(kind.maxwell_branches) for kind in kinds)


def _same(branch, own, time, place, F):
    found = slopes(branch.law, F)[place]
    assert np.allclose(found, 0 if own is None else slopes(own.law, F)[place], rtol=1e-10, atol=1e-9, equal_nan=True)
    value = ngs.CF(getattr(branch, time))(PLACES)[place]
    assert value == pytest.approx(1.0 if own is None else getattr(own, time))


@pytest.mark.parametrize(
    ("left", "right", "law"),
    [
        ("neo-hooke", "ogden", Ogden),
        ("maxwell", "neo-hooke", Ogden),
        ("demiray", "demiray, softer", Demiray),
        ("polynomial", "polynomial, other powers", Polynomial),
        ("prony of ogden", "maxwell", Ogden),
        ("gent", "demiray", Piecewise),
    ],
)
def test_tissues_of_one_family_share_one_energy(left, right, law):
    found = mix([(KINDS[left], LEFT), (KINDS[right], 1 - LEFT)])
    assert type(found.equilibrium) is law
    groups = group_by_family({"left": KINDS[left], "right": KINDS[right]})
    assert groups == ([["left"], ["right"]] if law is Piecewise else [["left", "right"]])


def test_every_family_of_the_catalogue_can_be_fields():
    laws = [instantaneous_law(viscous(entry.law())) for entry in CATALOGUE.values()]
    assert {type(law) for law in laws} == set(FAMILIES)
