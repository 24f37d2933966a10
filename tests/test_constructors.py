"""Constructors look at what they are given: type and range, before anything is made of it."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import Demiray, MooneyRivlin, NeoHooke, Prony, Shearing
from ngbrain.mesh import Sizes, block, cleft_to
from ngbrain.mesh.geometry.structured import boxes, rectangles

NAN, INF = float("nan"), float("inf")
LAW = NeoHooke(1e3)


@pytest.mark.parametrize("maxh", [0, -1, 1e-300, NAN, INF, 1e-6, 1j, "a", None, True + 0j, [0.1, 0.1]])
def test_element_sizes(maxh):
    with pytest.raises(InputError, match=r"block\.maxh"):
        block(maxh=maxh)


@pytest.mark.parametrize(
    "size", [NAN, (0, 1, 1), (1, NAN, 1), (1, 1), (1, 1, -1), "abc", (1, 1, INF), (1e9, 1, 1), None]
)
def test_sizes_of_a_block(size):
    with pytest.raises(InputError, match=r"block\.size"):
        block(size)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: Prony(LAW, [], []), "Prony.g"),
        (lambda: Demiray(1e3, INF), "Demiray.b"),
        (lambda: Demiray(NAN, 1.0), "Demiray.mu"),
        (lambda: MooneyRivlin(1j, 1.0), "c"),
        (lambda: MooneyRivlin(1.0, 1.0 + 1j), "c"),
        (lambda: NeoHooke(INF), "NeoHooke.mu"),
        (lambda: NeoHooke(1e3 + 1j), "NeoHooke.mu"),
        (lambda: NeoHooke(True), "NeoHooke.mu"),
        (lambda: NeoHooke("1000"), "NeoHooke.mu"),
        (lambda: NeoHooke(np.array([1.0, 2.0])), "NeoHooke.mu"),
        (lambda: Shearing(complex(NAN, 1)), "Shearing.mu"),
        (lambda: Shearing(complex(1, INF)), "Shearing.mu"),
        (lambda: Material(LAW, -1.0), "Material.bulk"),
        (lambda: Material(LAW, NAN), "Material.bulk"),
        (lambda: Material(LAW, 1e5 + 1j), "Material.bulk"),
        (lambda: Material(LAW, 1e5, -1.0), "Material.pointwise"),
        (lambda: Material(1e3, 1e5), "Material.law"),
        (lambda: Sizes(site=0.0), "Sizes.site"),
        (lambda: Sizes(far=NAN), "Sizes.far"),
        (lambda: Sizes(grading=0.0), "Sizes.grading"),
        (lambda: cleft_to(np.array([NAN, 0, 0])), "cleft.target_mm"),
        (lambda: cleft_to(np.array([0.02, 0, 0.03]), opening=-1.0), "opening"),
        (lambda: rectangles([0, INF], [0, 1]), "rectangles.x"),
        (lambda: boxes(np.ones((1, 1, 1), bool), [0, 1], [0, INF], [0, 1]), "boxes.y"),
    ],
)
def test_what_cannot_be_is_named(make, name):
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        make()


def test_what_can_be_is_taken():
    assert Material(LAW, INF).bulk_is_infinite and Shearing(1e3 + 200j).mu.imag == 200
    assert NeoHooke(np.float64(1e3)).mu == 1e3 and NeoHooke(1000).mu == 1000


@pytest.mark.parametrize("energy", [lambda C: 3.0, lambda C: 0, lambda C: None, lambda C: C])
def test_an_energy_is_a_function_of_stretch(energy):
    """A float has no derivative: `AttributeError` once."""
    law = type("Mine", (), {"energy": staticmethod(energy)})()
    with pytest.raises(InputError, match=r"Mine\.energy.*W in Pa|an initial|law"):
        Problem(block((0.1, 0.1, 0.1), 0.1), {".*": Material(law, 1e5)}, {"bottom": 0}, element="P1")
