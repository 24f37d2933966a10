"""JSON files, written atomically."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ngbrain.atomic import atomic_write


def write_json(path: Path, data: Any) -> None:
    """Write data as JSON, atomically; NaN and infinity are refused.

    Parameters
    ----------
    path : Path
        Output file.
    data : object
        JSON-compatible data.
    """
    text = json.dumps(data, indent=1, allow_nan=False)
    atomic_write(path, lambda part: part.write_text(text, encoding="utf-8"))
