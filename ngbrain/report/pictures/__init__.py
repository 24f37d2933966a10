"""The figures of the pages.

- `figures`: pressure curves and the strain slice of a retraction.
- `animation`: protocols side by side on one slice, at their peaks and over time.
- `volume`: the head in three dimensions, whole and cut open at the site.
- `slices`: three slices of the scan with labels and mesh.
- `cut_plane`: deformed tissue and blade in the plane of approach and push.
- `planes`: values at data points as images or triangulations.
- `plane_table`: pictures of many quantities on many planes, with colour bars.
- `gltf`: surfaces as glTF for augmented and virtual reality.
- `panel`: surfaces and volumes in one interactive scene.
- `timeline`: a protocol's run, interpolated in time.
- `frame`: tissue and blade of a protocol at one time.
- `tool`: sections and surfaces of the tools.
- `style`: common sizes, colours, strain scale and anatomical directions.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.report.pictures import (
        animation,
        cut_plane,
        figures,
        frame,
        gltf,
        panel,
        plane_table,
        planes,
        slices,
        style,
        timeline,
        tool,
        volume,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "animation",
    "cut_plane",
    "figures",
    "frame",
    "gltf",
    "panel",
    "plane_table",
    "planes",
    "slices",
    "style",
    "timeline",
    "tool",
    "volume",
]
