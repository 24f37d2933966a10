"""The final output of a verb."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ngbrain.progress import LOG


def conclude(quiet: bool, summary: Iterable[str], cautions: Sequence[str]) -> None:
    """Print a summary and the warnings; without a summary, warnings go to stderr.

    Parameters
    ----------
    quiet : bool
        No summary.
    summary : iterable of str
    cautions : sequence of str
        Warnings.
    """
    if not quiet:
        print(*summary, *cautions, sep="\n")
        return
    for caution in cautions:
        LOG.warning(caution)
