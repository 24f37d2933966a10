"""Results with the keys of their file `result.json`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ngbrain.result import Result


@dataclass(repr=False, eq=False)
class FileResult(Result, Mapping[str, Any]):
    """A result that is also a mapping with the keys of its file: `result["checks"]`.

    Parameters
    ----------
    data : dict
        Content of `result.json`.
    """

    data: dict[str, Any]

    def __getitem__(self, key: str) -> Any:
        return self.data[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.data)

    def __len__(self) -> int:
        return len(self.data)

    def to_dict(self) -> dict[str, Any]:
        """Content of `result.json`."""
        return self.data
