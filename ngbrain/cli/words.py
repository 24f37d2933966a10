"""What a verb says in the end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ngbrain.progress import LOG


def conclude(quiet: bool, summary: Iterable[str], cautions: Sequence[str]) -> None:
    """Print a summary and, after it, what a reader has to be warned of; that is said on stderr where there is no summary."""
    if not quiet:
        print(*summary, *cautions, sep="\n")
        return
    for caution in cautions:
        LOG.warning(caution)
