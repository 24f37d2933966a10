"""Named points of a head, and their file for 3D Slicer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ngbrain.image.read.label_map import LabelMap
from ngbrain.io.json_file import write_json

_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)
_ENDS = (("left", "right"), ("back", "front"), ("bottom", "top"))


def landmarks(labels: LabelMap) -> dict[str, np.ndarray]:
    """Name → point (3,) m: `centre` of the head; its outermost voxels `left`, `right`, `back`, `front`, `bottom`, `top`; the
    centre of every region as `centre of NAME`; the centres of the ventricles of both sides, `left ventricle` and `right
    ventricle`.

    Sides are those of the world coordinates in the file.

    >>> from ngbrain.image.read.volume import Volume
    >>> one = LabelMap(Volume(np.ones((3, 1, 1), int), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey"})
    >>> landmarks(one)["right"].tolist(), landmarks(one)["centre of grey"].tolist()
    ([0.002, 0.0, 0.0], [0.001, 0.0, 0.0])
    """
    numbered = labels.region_numbers()
    points = labels.volume.to_world(np.argwhere(numbered > 0))
    found = {"centre": points.mean(axis=0)}
    for axis, names in enumerate(_ENDS):
        for name, at in zip(names, (points[:, axis].argmin(), points[:, axis].argmax()), strict=True):
            found[name] = points[at]
    for number, name in enumerate(labels.regions, 1):
        mine = labels.volume.to_world(np.argwhere(numbered == number))
        found[f"centre of {name}"] = mine.mean(axis=0)
        if name == "ventricles":
            for side, part in (("left", mine[:, 0] < found["centre"][0]), ("right", mine[:, 0] > found["centre"][0])):
                if part.any():
                    found[f"{side} ventricle"] = mine[part].mean(axis=0)
    return found


def write_landmarks(path: Path, points: Mapping[str, ArrayLike]) -> None:
    """Write named points as a point list of 3D Slicer (`.mrk.json`), in mm and RAS.

    Parameters
    ----------
    path : Path
        Output file.
    points : mapping of str to array_like
        Name → point (3,) m.

    Examples
    --------
    >>> import json, pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "points.mrk.json")
    ...     write_landmarks(file, {"target": (0.024, -0.008, 0.04)})
    ...     json.loads(file.read_text())["markups"][0]["controlPoints"][0]["position"]
    [24.0, -8.0, 40.0]
    """
    places = {name: [round(1e3 * float(x), 4) for x in np.asarray(point)] for name, point in points.items()}
    listed = [{"id": str(i), "label": name, "position": place} for i, (name, place) in enumerate(places.items(), 1)]
    markup = {"type": "Fiducial", "coordinateSystem": "RAS", "coordinateUnits": "mm", "controlPoints": listed}
    write_json(path, {"@schema": _SCHEMA, "markups": [markup]})
