"""Page of a prediction: solves are listed where there were any."""

import pytest

from ngbrain.report.pages.prediction import facts

RESULT = {
    "model": {"operator": "waves", "squares": 3},
    "trust": {"coverage": {"0.95": {"storage_modulus": 2.1}}},
}


@pytest.mark.parametrize(("solves", "listed"), [({"forward": 0}, False), ({"forward": 2}, True)])
def test_solves_are_listed_where_there_were_any(solves, listed):
    assert ("Solves" in dict(facts(RESULT | {"solves": solves}))) is listed
