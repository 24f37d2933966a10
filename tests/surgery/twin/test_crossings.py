"""What a corridor crosses: structures of a label map by volume, those it only touches."""

from types import SimpleNamespace

import numpy as np
import pytest

from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.surgery.twin import crossings
from ngbrain.surgery.twin.crossings import corridor_crossings, corridor_points
from ngbrain.surgery.twin.spectrum import relaxation_modulus

CLEFT = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 20e-3, 4e-3, 12e-3)


def test_points_fill_the_corridor():
    points = corridor_points(CLEFT)
    assert len(points) == 20 * 4 * 12
    across, along, up = CLEFT.coordinates(points).T
    assert np.abs(across).max() < 2e-3 and np.abs(along).max() < 6e-3 and up.min() > 0 and up.max() < 20e-3


def test_structures_are_named_with_the_volume_in_the_corridor(monkeypatch):
    monkeypatch.setattr(crossings, "corridor_findings", lambda model: ["crosses the mid plane"])
    monkeypatch.setattr(crossings, "fluid_distance", lambda model, fluids: 4.0)
    labels = np.zeros((41, 41, 41), np.int16)
    labels[:, :, 20:30] = 1  # z from -.5 mm to 9.5 mm
    labels[24:, :, 30:] = 2  # beside the corridor from x = 3.5 mm on
    affine = np.diag([1e-3, 1e-3, 1e-3, 1.0])
    affine[:3, 3] = -20e-3
    structures = LabelMap(Volume(labels, affine), {1: "deep", 2: "beside"})
    found = corridor_crossings(SimpleNamespace(cleft=CLEFT), (), structures)
    # 4 by 12 mm over 9.5 mm
    assert found["structures_ml"] == {"deep": pytest.approx(0.456, rel=0.06)} and found["touched"] == ["beside"]
    assert found["findings"] == ["crosses the mid plane"] and found["fluid_mm"] == 4.0 and found["depth_mm"] == 20.0


def test_a_spring_pots_relaxation_is_that_of_its_stress_over_strain():
    # ∫ of G(t) exp(-iωt) iω dt over a long time gives G* back: at a = .3, |G*| = 2 kPa, 40 Hz
    exponent, omega = 0.3, 2 * np.pi * 40
    tangent = np.tan(np.pi * exponent / 2)
    t = np.logspace(-9, 1, 400001)
    values = np.array([relaxation_modulus(2000.0, tangent, 40.0, float(each)) for each in t[::4000]])
    slope = np.polyfit(np.log(t[::4000]), np.log(values), 1)[0]
    assert slope == pytest.approx(-exponent)
    # the cosine transform of t^-a is Γ(1-a) sin(πa/2) ω^(a-1): with G(t) = κ t^-a / Γ(1-a) the loss is κ ω^a sin(πa/2)
    loss = 2000.0 * np.sin(np.arctan(tangent))
    at_one = relaxation_modulus(2000.0, tangent, 40.0, 1.0)
    from math import gamma

    assert at_one * gamma(0.7) * omega**exponent * np.sin(np.pi * exponent / 2) == pytest.approx(loss)
