"""Named points of a head."""

from __future__ import annotations

import numpy as np

from ngbrain.image.read.label_map import LabelMap

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
