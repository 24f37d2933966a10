"""Waves in the time convention e^{-iωt}. Naive: they are inverted as they are. Ours: they are refused, or conjugated if asked.

CV-G conjugated, on half of its points with 1 % noise: the naive loss is more than 90 % off, as it cannot be negative, and the
storage modulus with it; conjugated both are as good as in the right convention.
"""

import pytest

from ngbrain.errors import InputError
from ngbrain.inverse.elastography import invert as module
from ngbrain.inverse.phantoms.benchmark import Phantom


def errors(data):
    found = module.invert(data, noise=0.01, uniform=False, regulariser="smooth", max_iterations=12)
    return [found.answers[name]["relative_l2_error"] for name in ("storage", "loss")]


def test_naive_the_wrong_convention_spoils_both_moduli(monkeypatch):
    monkeypatch.setattr(module, "check_passive", lambda data: None)
    storage, loss = errors(Phantom.from_name("CV-G", 25).simulate_measurements(0.01).data().conjugate())
    print(storage, loss)
    assert storage > 0.05 and loss > 0.9


def test_ours_refuses_it_and_holds_once_conjugated():
    data = Phantom.from_name("CV-G", 25).simulate_measurements(0.01).data().conjugate()
    with pytest.raises(InputError, match="gain energy"):
        module.invert(data)
    storage, loss = errors(data.conjugate())
    assert storage < 0.02 and loss < 0.1
