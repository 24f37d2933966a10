"""First answers of a quick run: their intervals, and whether the refined answers lie inside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ngbrain.report.words import display_unit, duration, number
from ngbrain.surgery.uncertainty.error_budget import UNDER_WAY

COARSE = (
    "First answer, coarse; refinement under way, or it was when this stopped. The numbers and pictures of this page are those of "
    "{}. The table of first answers says where those of the scene as described should lie"
)
PROTOCOLS = "Protocols under way when this page was written; they are added as they finish: {}"
WAITING = "under way"


def under_way(result: Mapping[str, Any]) -> list[str]:
    """Sentences on what was not done when the result was written, checks aside.

    Parameters
    ----------
    result : mapping of str to Any
        The contents of `result.json`.

    Returns
    -------
    list of str

    Examples
    --------
    >>> under_way({"protocol_status": {"continuous": "computed", "staged": "under way"}})
    ['Protocols under way when this page was written; they are added as they finish: staged']
    """
    first = result.get("first_answers") or {}
    found = [COARSE.format(first["model"])] if first and not first["refined"] else []
    waiting = [name for name, status in (result.get("protocol_status") or {}).items() if status == UNDER_WAY]
    return found + ([PROTOCOLS.format(", ".join(waiting))] if waiting else [])


def rows(first: Mapping[str, Any]) -> list[tuple[str, str, str, str, str, str]]:
    """Rows of the table of first answers.

    Parameters
    ----------
    first : mapping of str to Any
        `first_answers` of a result.

    Returns
    -------
    list of tuple of str
        Protocol, quantity, first answer, interval, refined answer, whether it lies inside.

    Examples
    --------
    >>> one = {"protocol": "continuous", "name": "peak pressure", "unit": "mmHg", "value": 127.4}
    >>> rows({"refined": True, "answers": [one | {"interval": [110.0, 148.0], "refined": 117.7, "inside": True}]})
    [('continuous', 'peak pressure', '127 mmHg', '110 to 148 mmHg', '118 mmHg', 'inside')]
    """
    found = []
    for each in first.get("answers", ()):
        low, high = each["interval"] or (None, None)
        inside = {True: "inside", False: "OUTSIDE", None: "" if low is not None else "not known"}[each["inside"]]
        refined = _shown(each["refined"], each["unit"])
        if each["refined"] is None:
            refined = "–" if first["refined"] else WAITING
        interval = "not known" if low is None else f"{_bare(low, each['unit'])} to {_shown(high, each['unit'])}"
        found.append((each["protocol"], each["name"], _shown(each["value"], each["unit"]), interval, refined, inside))
    return found


def sentence(first: Mapping[str, Any]) -> str:
    """When the first answers were there, what their intervals are made of, and how many refined answers lie inside.

    Parameters
    ----------
    first : mapping of str to Any
        `first_answers` of a result; empty gives an empty text.

    Returns
    -------
    str
    """
    if not first:
        return ""
    judged = [each["inside"] for each in first["answers"] if each["inside"] is not None]
    lay = f" {sum(judged)} of {len(judged)} refined answers lie inside." if judged else ""
    return f"They were there after {duration(first['time_s'])}, from {first['model']}. {first['basis']}{lay}"


def _bare(value: float | None, unit: str) -> str:
    return number(None if value is None else display_unit(unit)[1] * value)


def _shown(value: float | None, unit: str) -> str:
    return f"{_bare(value, unit)} {display_unit(unit)[0]}"
