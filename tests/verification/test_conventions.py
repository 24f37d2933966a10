"""Conventions that codes and papers differ in: ours, and that the other one is noticed or gives another number.

The table of tutorials/guide/reference/conventions.md names a test for each, most of them here.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.image.mre.strain import octahedral_strain
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.landmarks import landmarks
from ngbrain.image.read.volume import Volume
from ngbrain.inverse.data.time_convention import check_passive
from ngbrain.io.waves import WaveData
from ngbrain.io.waves.samples import samples_to_amplitudes
from ngbrain.materials import (
    Demiray,
    Gent,
    LinearElastic,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    Prony,
    Viscous,
    Yeoh,
)
from ngbrain.materials.lab import relaxation, stress
from ngbrain.materials.points import initial_modulus, number
from ngbrain.materials.viscous import Branch
from ngbrain.surgery.measures.injury import Strain, von_mises
from ngbrain.tensors import octahedral_shear

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "tutorials/guide/reference/conventions.md"
POINTS = np.array([[x, y] for y in range(16) for x in range(16)]) * 3e-3
WAVENUMBER = 2 * np.pi * 60 * np.sqrt(1000 / (2500 + 500j))  # 1/m of G* = 2500 + 500i Pa at 60 Hz
AMPLITUDE = 1e-5 * np.stack([np.exp(-1j * WAVENUMBER * POINTS[:, k]) for k in (1, 0)], axis=1)  # m, Re(u e^{+iωt})
GAMMA = 0.01


def waves(u):
    return WaveData(POINTS, u[None], [60.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)


def sampled(times):
    """What a scan reads of the waves at these parts of a period."""
    samples = np.real(AMPLITUDE[None, ..., None] * np.exp(2j * np.pi * np.asarray(times)))
    return samples_to_amplitudes({"points": POINTS, "frequency": [60.0], "samples": samples})["displacement"][0]


def test_the_time_sign_is_plus():
    check_passive(waves(AMPLITUDE))
    with pytest.raises(InputError, match="gain energy"):
        check_passive(waves(AMPLITUDE.conj()))


def test_phase_images_are_in_the_order_of_time():
    times = np.arange(4) / 4
    assert np.allclose(sampled(times), AMPLITUDE, rtol=1e-12, atol=1e-18)
    with pytest.raises(InputError, match="gain energy"):
        check_passive(waves(sampled(-times)))


def test_the_last_phase_image_is_not_the_first_again():
    with pytest.raises(InputError, match="samples"):
        sampled(np.linspace(0, 1, 5))


def test_x_points_to_the_right_y_to_the_front_z_to_the_top():
    voxels = np.zeros((3, 3, 3), int)
    voxels[2, 1, 1] = voxels[1, 2, 1] = voxels[1, 1, 2] = voxels[0, 1, 1] = 1
    found = landmarks(LabelMap(Volume(voxels, np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey"}))
    assert found["right"] == pytest.approx([2e-3, 1e-3, 1e-3]) and found["left"] == pytest.approx([0, 1e-3, 1e-3])
    assert found["front"] == pytest.approx([1e-3, 2e-3, 1e-3]) and found["top"] == pytest.approx([1e-3, 1e-3, 2e-3])


def test_shear_strain_is_that_of_the_tensor():
    strain = np.zeros((1, 3, 3))
    strain[0, 0, 1] = strain[0, 1, 0] = GAMMA / 2
    ours = float(octahedral_strain(strain)[0])
    assert ours == pytest.approx(float(octahedral_shear(np.array([[GAMMA / 2, 0, -GAMMA / 2]]))[0]), rel=1e-12)
    assert ours == pytest.approx(2 / 3 * np.sqrt(6) * GAMMA / 2, rel=1e-12)
    assert float(octahedral_strain(2 * strain)[0]) == pytest.approx(2 * ours)  # the engineering strain: twice as much


LAWS = {
    "Neo-Hooke": (NeoHooke(700.0), 700.0),
    "Ogden": (Ogden(mu=[600.0, 100.0], alpha=[-19.0, 2.0]), 700.0),
    "Mooney-Rivlin": (MooneyRivlin(200.0, 150.0), 700.0),
    "Yeoh": (Yeoh(350.0, 900.0), 700.0),
    "Gent": (Gent(700.0, 0.5), 700.0),
    "Demiray": (Demiray(700.0, 6.0), 700.0),
}


@pytest.mark.parametrize("name", LAWS)
def test_constants_give_the_initial_shear_modulus(name):
    law, modulus = LAWS[name]
    assert number(initial_modulus(law)) == pytest.approx(modulus, rel=1e-9)
    assert stress(law, "shear", [1e-4])[0] / 1e-4 == pytest.approx(modulus, rel=1e-5)


def test_ogden_of_another_convention_is_another_law():
    # W = Σ c/α² (Σ λ^α - 3), as FEBio has it, with c = 700 is ours with μ = c/2; W = Σ μ/α (…) with 700 is ours with αμ/2.
    strain, alpha, least = np.array([1.2]), 4.0, 0.3
    ours = stress(Ogden(700.0, alpha), "uniaxial", strain)
    stretch = strain[0]
    nominal = stretch ** (alpha - 1) - stretch ** (-alpha / 2 - 1)  # ∂(Σ λ^α)/∂λ over α
    assert ours[0] == pytest.approx(2 * 700 / alpha * nominal, rel=1e-9)
    for other in (700 / alpha * nominal, 700 * nominal):
        assert abs(other / ours[0] - 1) > least


def test_the_law_of_a_prony_series_is_the_instantaneous_one():
    times = [1e-9, 1e9]
    shear = relaxation(Prony(NeoHooke(1000.0), g=[0.4], tau=[2.0]), "shear", GAMMA, times) / GAMMA
    assert shear == pytest.approx([1000.0, 600.0], rel=1e-6)
    lasting = relaxation(Viscous(NeoHooke(1000.0), (Branch(NeoHooke(400.0), 2.0),)), "shear", GAMMA, times) / GAMMA
    assert lasting == pytest.approx([1400.0, 1000.0], rel=1e-6)


def test_stress_of_a_test_is_nominal_and_von_mises_is_cauchy():
    stretch, modulus = 1.5, 1000.0
    nominal, cauchy = modulus * (stretch - stretch**-2), modulus * (stretch**2 - 1 / stretch)
    assert stress(NeoHooke(modulus), "uniaxial", [stretch])[0] == pytest.approx(nominal, rel=1e-9)
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    assert von_mises(F[None], np.diag([nominal, 0, 0])[None])[0] == pytest.approx(cauchy, rel=1e-12)
    assert cauchy / nominal == pytest.approx(stretch)


def test_principal_strain_is_green_lagrange_and_octahedral_strain_logarithmic():
    stretch = np.array([[0.9, 1.0, 1.3]])
    strain = Strain(stretch)
    assert strain.mps[0] == pytest.approx((1.3**2 - 1) / 2) and strain.mps[0] > 1.3 * np.log(1.3)
    assert strain.oss[0] == pytest.approx(float(octahedral_shear(np.log(stretch))[0]))
    assert strain.oss[0] < 0.97 * float(octahedral_shear((stretch**2 - 1) / 2)[0])


def test_lame_constants_are_of_small_strain():
    # LinearElastic's μ is that of σ = 2 μ ε, ε the tensor's: a shear γ = 2 ε₁₂ takes the stress μ γ.
    assert stress(LinearElastic(700.0, 1e5), "shear", [GAMMA])[0] == pytest.approx(700 * GAMMA, rel=1e-9)


def test_the_page_names_tests_that_are_there():
    named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", PAGE.read_text())
    assert len(named) >= 8
    for file, name in named:
        text = (ROOT / file).read_text()
        assert not name or f"def {name}(" in text, f"{file}::{name}"
