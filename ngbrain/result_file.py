"""Results that read as the `result.json` that is written of them does."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ngbrain.result import Result


@dataclass(repr=False, eq=False)
class FileResult(Result, Mapping[str, Any]):
    """A result whose keys are those of its file: `result["checks"]`.

    Parameters
    ----------
    data
        What `result.json` holds.
    """

    data: dict[str, Any]

    def __getitem__(self, key: str) -> Any:
        return self.data[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.data)

    def __len__(self) -> int:
        return len(self.data)

    def to_dict(self) -> dict[str, Any]:
        """What `result.json` holds."""
        return self.data
