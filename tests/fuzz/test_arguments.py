"""Public constructors given one odd argument: what they make of it, or one line; no other exception, and no crash."""

import warnings

import numpy as np
import pytest

pytest.importorskip("hypothesis")

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import ngbrain.materials as materials
from ngbrain.errors import NgbrainError
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.io.waves import WaveData
from ngbrain.materials import modulus
from ngbrain.mesh import Sizes, block, cleft_to
from ngbrain.mesh.geometry.structured import boxes, rectangles
from ngbrain.scene import DisplacementBC, Geometry, Gravity, MeshSize, Quantity, Scene, Time, Tissue, Traction
from ngbrain.surgery.observations import Observations

LAW = materials.NeoHooke(1e3)
CUBE = block((0.1, 0.1, 0.1), 0.1)
GRID = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
CONSTRUCTORS = {
    "NeoHooke": (materials.NeoHooke, {"mu": 1e3}),
    "MooneyRivlin": (materials.MooneyRivlin, {"c10": 1e3, "c01": 10.0}),
    "Demiray": (materials.Demiray, {"mu": 1e3, "b": 2.0}),
    "Gent": (materials.Gent, {"mu": 1e3, "jm": 2.0}),
    "Ogden": (materials.Ogden, {"mu": [1e3, 2e3], "alpha": [-2.0, 3.0]}),
    "Yeoh": (materials.Yeoh, {"c1": 1e3, "c2": 1.0}),
    "Prony": (materials.Prony, {"law": LAW, "g": [0.3], "tau": [1.0]}),
    "HolzapfelGasserOgden": (
        materials.HolzapfelGasserOgden,
        {"mu": 1e3, "k1": 10.0, "k2": 1.0, "kappa": 0.1, "fibre": (0, 0, 1)},
    ),
    "Shearing": (materials.Shearing, {"mu": 1e3 + 1j}),
    "PronySeries": (modulus.PronySeries, {"mu": 1e3, "g": [0.5], "tau": [0.1]}),
    "Springpot": (modulus.Springpot, {"kappa": 1e3, "exponent": 0.3}),
    "KelvinVoigt": (modulus.KelvinVoigt, {"mu": 1e3, "eta": 1.0}),
    "Material": (Material, {"law": LAW, "bulk": 1e5, "pointwise": 0.0}),
    "block": (block, {"size": (0.1, 0.1, 0.1), "maxh": 0.1}),
    "Sizes": (Sizes, {"site": 2e-3, "near": 6e-3, "far": 2e-2, "grading": 0.7}),
    "cleft_to": (cleft_to, {"target": np.array([0.02, 0, 0.03]), "opening": 4e-3, "width": 12e-3}),
    "rectangles": (rectangles, {"x": np.arange(3.0), "y": np.arange(2.0)}),
    "boxes": (boxes, {"cells": np.ones((1, 1, 1), bool), "x": [0, 1.0], "y": [0, 1.0], "z": [0, 1.0]}),
    "Tissue": (Tissue, {"region": ".*", "mu": 1e3, "poissons_ratio": 0.3}),
    "Geometry": (Geometry, {"kind": "block", "size": (0.1, 0.1, 0.1)}),
    "MeshSize": (MeshSize, {"largest": 0.02, "order": 2}),
    "DisplacementBC": (DisplacementBC, {"boundary": "top", "value": (0, 0, 1e-3), "components": "xyz"}),
    "Traction": (Traction, {"boundary": "top", "value": (0, 0, 1.0)}),
    "Gravity": (Gravity, {"acceleration": (0, 0, -9.81)}),
    "Time": (Time, {"ramp": 1.0, "end": 2.0}),
    "Quantity": (Quantity, {"name": "force", "boundary": "top", "tolerance": 0.1, "direction": (0, 0, 1)}),
    "Scene": (
        Scene,
        {
            "geometry": Geometry(kind="block", size=(0.1, 0.1, 0.1)),
            "tissues": (Tissue(mu=1e3),),
            "displacement_bcs": (DisplacementBC(boundary="top"),),
            "quantities": (Quantity(name="force", boundary="top"),),
        },
    ),
    "Observations": (
        Observations,
        {
            "times": np.array([1.0]),
            "landmarks": np.zeros((1, 3)),
            "displacements": np.zeros((1, 1, 3)),
            "force": np.zeros(1),
            "sigma": (1e-3, 1.0),
        },
    ),
    "WaveData": (
        WaveData,
        {
            "points": GRID,
            "displacement": 1e-6 * np.ones((1, 9, 2)),
            "frequency": [50.0],
            "density": 1000.0,
            "symmetry": "isotropic",
            "rheology": "elastic",
            "poisson": 0.49,
        },
    ),
    "Problem": (
        Problem,
        {"mesh": CUBE, "materials": {".*": Material(LAW, 1e5)}, "boundary_conditions": {"bottom": 0}, "element": "P1"},
    ),
}
ODD = st.one_of(
    st.sampled_from(
        [None, "", "a", "\x00", True, [], (), {}, b"x", object(), 1j, -1, 0, 0.0, -0.0, 10**400, 1e300, 1e-300]
    ),
    st.sampled_from(
        [float("nan"), float("inf"), -float("inf"), [float("nan")] * 3, (1.0, 2.0), [[1.0], [1.0, 2.0]], range(5)]
    ),
    st.sampled_from(
        [
            np.zeros(3),
            np.zeros((2, 2)),
            np.array("x"),
            np.array([None]),
            np.float32(-1),
            np.zeros((0, 3)),
            LAW,
        ]
    ),
    st.floats(allow_nan=True, allow_infinity=True),
    st.integers(-3, 2**70),
    st.text(max_size=5),
)


def one_line(make, arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            make(**arguments)
        except NgbrainError as error:
            assert "\n" not in str(error)
        except TypeError as error:  # an argument of another name or number: Python's own line
            assert "argument" in str(error)


@pytest.mark.parametrize("name", CONSTRUCTORS)
def test_the_arguments_here_are_right(name):
    make, arguments = CONSTRUCTORS[name]
    make(**arguments)


@pytest.mark.parametrize("name", CONSTRUCTORS)
@settings(max_examples=12, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_one_odd_argument(name, data):
    make, arguments = CONSTRUCTORS[name]
    odd = data.draw(st.sampled_from(sorted(arguments)))
    one_line(make, {**arguments, odd: data.draw(ODD)})


@pytest.mark.slow
@pytest.mark.parametrize("name", CONSTRUCTORS)
@settings(max_examples=150, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_one_odd_argument_of_many(name, data):
    make, arguments = CONSTRUCTORS[name]
    odd = data.draw(st.sampled_from(sorted(arguments)))
    one_line(make, {**arguments, odd: data.draw(ODD)})
