"""Small results as JSON files that are whole or not there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ngbrain.atomic import atomic_write


def write_json(path: Path, data: Any) -> None:
    """Write, then rename: a reader never sees half a file. NaN and infinity are refused."""
    text = json.dumps(data, indent=1, allow_nan=False)
    atomic_write(path, lambda part: part.write_text(text, encoding="utf-8"))
