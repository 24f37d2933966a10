"""First answers of a scene, compared with the refined ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

Result = dict[str, Any]
"""The contents of `result.json`, or a part of them."""


def compare(first: Mapping[str, Any], refined: Callable[[Mapping[str, Any]], float | None]) -> Result:
    """First answers with refined values, and whether these lie in their intervals.

    Parameters
    ----------
    first : mapping
        `first_answers` of a result.
    refined : callable
        The refined value of a first answer; None where it is not known yet.

    Returns
    -------
    dict
    """

    def judged(each: Mapping[str, Any]) -> Result:
        value, interval = refined(each), each["interval"]
        inside = None if value is None or interval is None else interval[0] <= value <= interval[1]
        return {**each, "refined": value, "inside": inside}

    return {**first, "answers": [judged(each) for each in first["answers"]]}
