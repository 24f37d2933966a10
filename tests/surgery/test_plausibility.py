"""Moduli implausible for brain cause a warning, or an error far outside the range."""

import re
from types import SimpleNamespace as Namespace

import pytest

from ngbrain.errors import ImplausibleWarning, InputError
from ngbrain.materials import CATALOGUE
from ngbrain.surgery.plausibility import BRAIN, check_moduli


def made(**moduli):
    """The part of a model that the check uses."""
    return Namespace(parts=lambda: {name: Namespace(modulus=modulus) for name, modulus in moduli.items()})


def test_published_moduli_are_fine():
    assert check_moduli(made(cortex=2380.0, white=1380.0, stem=280.0, lesion=6825.0)) == []


def test_others_are_warned_of_by_name():
    with pytest.warns(
        ImplausibleWarning, match=r"280 to 6825 Pa published for brain: grey 40 Pa, lesion 8e\+04 Pa"
    ) as caught:
        said = check_moduli(made(grey=40.0, white=700.0, lesion=8e4))
    assert said == [str(caught[0].message)] and len(caught) == 1


@pytest.mark.parametrize("modulus", [0.936, 2.79, 6.9e5])
def test_what_is_a_hundred_times_beyond_is_refused(modulus):
    with pytest.raises(
        InputError, match=re.escape(f"modulus of white (mu_Pa) is {modulus:.3g} Pa; wanted: ") + ".*not kPa"
    ):
        check_moduli(made(grey=1000.0, white=modulus))


def test_every_region_of_the_catalogue_is_brain_or_not():
    """A new region has to be classified."""
    others = {"ventricles", "cranial dura mater", "pia-arachnoid complex", "pia mater", "skull, all layers"}
    assert {entry.region for entry in CATALOGUE.values()} == BRAIN | others and not BRAIN & others
