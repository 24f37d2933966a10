"""Patterns are bounded in the work that they can make."""

import re
import string

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block
from ngbrain.scene import Tissue
from ngbrain.schema.patterns import LONGEST, MOST, ways


@pytest.mark.parametrize(
    ("pattern", "most"),
    [
        ("brain", 1),
        ("cortex|white", 2),
        ("ventricle.*", LONGEST),
        (r"^(?!ventricle).*", LONGEST),
        (r"wall_(plus|minus)", 1),
        (r"(grey|white)_(left|right)_(grey|white)_cerebellum", 1),
        ("(?:a|b)+", LONGEST),
        ("wall_(top|tip)", 2),
        ("[a-z]+_[0-9]{1,3}", 3 * LONGEST),
        (r"\(a\*", 1),
        ("[)|*]x", 1),
        ("[]*]x", 1),
    ],
)
def test_usual_patterns_are_cheap(pattern, most):
    assert re.compile(pattern) and ways(pattern) == most <= MOST
    assert Tissue(region=pattern, mu=(1000.0,)).region == pattern


@pytest.mark.parametrize(
    "pattern",
    [
        "(.*)*(.*)*(.*)*(.*)*z",
        "(a+)+$",
        "(a|a)*b",
        "(a|aa)+$",
        "(.*a){20}",
        ".*.*.*.*.*z",
        "a?" * 40 + "a" * 40,
        "(a|a)" * 30,
        "([a-z]+)*x",
        "((ab)*)*",
        "(a?){50}b",
        "a{0,60}a{0,60}a{0,60}a{0,60}a{0,60}b",
    ],
)
def test_patterns_that_take_for_ever_are_refused(pattern):
    assert re.compile(pattern) and ways(pattern) > MOST
    with pytest.raises(InputError, match="region"):
        Tissue(region=pattern, mu=(1000.0,))


def test_no_pattern_that_passes_takes_long(rng):
    """Random ones; Python's own matcher counts as its steps the characters that a pattern of its scanner visits."""
    letters = [*"ab.*+?|()", "[ab]", "{0,3}", "a*", "(a|b)"]
    tried = 0
    for _ in range(4000):
        pattern = "".join(rng.choice(letters, rng.integers(1, 14)))
        try:
            compiled = re.compile(pattern)
        except re.error:
            continue
        assert ways(pattern) >= 1
        if ways(pattern) <= 1e4:
            tried += 1
            compiled.fullmatch("ab" * 30 + "!")
    assert tried > 300
    assert ways("".join(rng.permutation(np.array(list(string.ascii_letters))))) == 1


@pytest.mark.parametrize("part", ["tissue", "support", "load"])
def test_bodies_refuse_what_would_take_minutes(part):
    mesh, endless = block((0.02, 0.02, 0.02), 0.02), "(.*)*(.*)*(.*)*z"
    materials = {endless if part == "tissue" else ".*": Material(NeoHooke(1e3), 5e3)}
    supports = {"bottom": 0} | ({endless: 0} if part == "support" else {})
    loads = [TractionLoad(endless if part == "load" else "top", (0, 0, 1.0))]
    with pytest.raises(InputError, match="at most four repeats"):
        Problem(mesh, materials, supports, loads)
