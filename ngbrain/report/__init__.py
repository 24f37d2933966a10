"""Self-contained HTML reports of results, in pictures and tables, that open offline.

- pages: `write_page` writes one from its template and pictures
- pictures: `DeformedHead` of a run at one time, `CutPlane` of approach and push, `ScanImage` with labels and mesh, `StrainScale`
- rendering of surfaces: `Camera`, `Layer`

Modules
-------
- `pages`: one HTML page for each kind of result.
- `pictures`: the figures of the pages.
- `render`: a small software renderer for surfaces.
- `words`: numbers, lengths and times as text.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.report import pages, pictures, render, words
    from ngbrain.report.pages.page import write_page
    from ngbrain.report.pictures.cut_plane import CutPlane
    from ngbrain.report.pictures.frame import DeformedHead
    from ngbrain.report.pictures.slices import ScanImage
    from ngbrain.report.pictures.style import StrainScale
    from ngbrain.report.render.renderer import Camera, Layer
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "Camera",
    "CutPlane",
    "DeformedHead",
    "Layer",
    "ScanImage",
    "StrainScale",
    "pages",
    "pictures",
    "render",
    "words",
    "write_page",
]
