"""First answers on a page: intervals, refined values, and what is under way."""

from ngbrain.report.pages.first_answers import rows, sentence, under_way

ANSWER = {
    "protocol": "staged",
    "quantity": "mps_p95",
    "name": "strain",
    "unit": "",
    "value": 0.21,
    "interval": [0.2, 0.23],
}
FIRST = {"model": "elements of 5.66 mm on the walls of the cleft", "basis": "Of a record.", "time_s": 75.0}


def first(refined, *answers):
    return FIRST | {"refined": refined, "answers": [ANSWER | each for each in answers]}


def test_rows_say_what_is_known():
    waiting, lay, off = (
        {"refined": None, "inside": None},
        {"refined": 0.22, "inside": True},
        {"refined": 0.24, "inside": False},
    )
    unknown = {"refined": 0.22, "inside": None, "interval": None}
    found = rows(first(False, waiting, lay, off, unknown))
    assert found[0] == ("staged", "strain", "21.0 %", "20.0 to 23.0 %", "under way", "")
    assert [row[4:] for row in found[1:]] == [("22.0 %", "inside"), ("24.0 %", "OUTSIDE"), ("22.0 %", "not known")]
    assert found[3][3] == "not known"
    assert rows(first(True, waiting))[0][4] == "–" and rows({}) == []


def test_a_sentence_counts_what_lies_inside():
    told = sentence(first(True, {"refined": 0.22, "inside": True}, {"refined": 0.24, "inside": False}))
    assert told.startswith(
        "They were there after 1 min 15 s, from elements of 5.66 mm on the walls of the cleft. Of a record."
    )
    assert told.endswith("1 of 2 refined answers lie inside.")
    assert "inside" not in sentence(first(False, {"refined": None, "inside": None})) and sentence({}) == ""


def test_a_coarse_page_says_so_until_it_is_refined():
    coarse, refined = ({"first_answers": first(each)} for each in (False, True))
    (told,) = under_way(coarse)
    assert told.startswith("First answer, coarse; refinement under way") and "elements of 5.66 mm" in told
    assert under_way(refined) == [] and under_way({}) == []
    both = coarse | {"protocol_status": {"continuous": "computed", "staged": "under way"}}
    assert "finish: staged" in under_way(both)[1]
