"""The page that all others are reached from."""

import _overview


def overview() -> str:
    return _overview.overview()


def behind() -> str:
    return _overview.behind()


def counted() -> str:
    found = [r for r in _overview.results() if r.mine and r.other]
    ahead = sum(not r.behind for r in found)
    return f"Of {len(found)} problems that others solve too ngbrain is ahead, or even, in cost and in what it reaches in {ahead}."
