"""A fit from one poor guess ends in a worse valley; several starts find the better one."""

import pytest

from ngbrain.materials import Ogden, lab

REGIONS = ["cortex", "corona_radiata", "basal_ganglia", "corpus_callosum"]
WRONG_SIGN = {"mu": 1000.0, "alpha": 10.0}


@pytest.mark.parametrize("region", REGIONS)
def test_naive_one_start_with_the_wrong_sign_stays_there(region):
    trapped = lab.fit(Ogden, lab.budday(region), WRONG_SIGN, starts=1)
    assert trapped.parameters["alpha"] > 0 and trapped.r2["compression"] < 0.6


@pytest.mark.parametrize("region", REGIONS)
def test_several_starts_find_the_better_valley(region):
    trapped = lab.fit(Ogden, lab.budday(region), WRONG_SIGN, starts=1)
    found = lab.fit(Ogden, lab.budday(region), WRONG_SIGN)
    assert -30 < found.parameters["alpha"] < -15 and min(found.r2.values()) > 0.9
    assert found.residual < 0.4 * trapped.residual and 1 < found.reached < found.starts
