"""Check that a regular expression is quick to match: no exponential backtracking."""

from __future__ import annotations

import re
import warnings

REPEATS = "at most four repeats, none within another"
"""Limit on repeats, in words."""
WANTED = f"a name or a regular expression (ECMAScript, up to 200 characters, {REPEATS})"
"""What `is_pattern` accepts, in words."""
LONGEST = 64
"""Approximate maximum length of a name: number of counts that an unlimited repeat tries."""
MOST = float(LONGEST**4)
"""Maximum number of ways to match a name: that of four unlimited repeats in a row."""
_QUANTIFIER = re.compile(r"(?:[*+?]|\{(\d+)(?:(,)(\d*))?\})\??")
_OPENING = re.compile(r"\((?:\?[:=!])?")
_ITEM = re.compile(r"\\.|\[\^?\]?(?:\\.|[^\]\\])*\]|[^\\\[()|]")


def is_pattern(text: str) -> bool:
    """Whether a text is a name, or a regular expression that means the same to Python and NGSolve and is quick to match.

    >>> is_pattern("grey|white.*"), is_pattern("(.*)*z")
    (True, False)
    """
    try:
        with warnings.catch_warnings(action="ignore"):
            # NGSolve does not support (?i), (?P<name>…), (?<!…) or {,n}, and takes minutes for very long patterns.
            if not text.strip() or len(text) > 200 or re.search(r"\(\?[^:=!]|\{,", text):
                return False
            re.compile(text)
            return ways(text) <= MOST
    except (re.error, OverflowError, RecursionError):
        return False


def ways(pattern: str) -> float:
    """Upper bound of the number of ways in which a pattern can match a name; a failing match tries all of them.

    Infinite where a repeated group can itself match in several ways.

    >>> ways("white|grey.*"), ways("(.*)*z"), ways("a?a?aa")
    (65.0, inf, 4.0)
    """
    found, at = _branches(pattern, 0)
    return found if at == len(pattern) else float("inf")


def _branches(pattern: str, at: int) -> tuple[float, int]:
    """Number of ways of the alternatives up to a closing parenthesis or the end, and the index of that end."""
    total, here = 0.0, 1.0
    while at < len(pattern) and pattern[at] != ")":
        if pattern[at] == "|":
            total, here, at = total + here, 1.0, at + 1
            continue
        if opening := _OPENING.match(pattern, at):
            inner, at = _branches(pattern, opening.end())
            if _are_distinct_words(pattern[opening.end() : at]):
                inner = 1.0
            at += 1
        elif item := _ITEM.match(pattern, at):
            inner, at = 1.0, item.end()
        else:
            return float("inf"), len(pattern)
        if quantifier := _QUANTIFIER.match(pattern, at):
            at = quantifier.end()
            repeats = _repeats(quantifier)
            inner = inner + 1 if quantifier[0][0] == "?" else repeats if inner == 1 else float("inf")
        here *= inner
    return total + here, at


def _are_distinct_words(inner: str) -> bool:
    """Whether all alternatives are plain words with different first letters, so that at most one can match."""
    words = inner.split("|")
    return all(re.fullmatch(r"[\w-]+", word) for word in words) and len({word[0] for word in words}) == len(words)


def _repeats(quantifier: re.Match[str]) -> float:
    """Number of possible repeat counts."""
    least, comma, most = quantifier.groups()
    if least is None or (comma and not most):
        return 2.0 if quantifier[0][0] == "?" else float(LONGEST)
    return float(min(int(most or least) - int(least) + 1, LONGEST)) if len(least + (most or "")) < 9 else float("inf")
