"""One self-contained HTML page for each kind of result.

- `anatomy`: the mesh of a head: slices, surfaces, histograms, tables.
- `calibration`: stiffness factors of a patient's tissues, fitted to a retraction.
- `cohort`: many scans or cases: verdicts, outliers, distributions.
- `elastography`: an inversion of wave data: waves and fit, maps, tables.
- `ladder`: the cheapest adequate model of a loaded body and its error estimates.
- `prediction`: a neural operator's prediction from wave data: trust, maps, tables.
- `preview`: a scene before it is computed: geometry, boundary conditions, tool.
- `retraction`: a retraction: pictures, findings, tables.
- `page`: writes a page from its template and pictures.
- `parameters`: names, units and tables of elastography parameters.
- `tables`: tables and sentences of the retraction report.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.report.pages import (
        anatomy,
        calibration,
        cohort,
        elastography,
        ladder,
        page,
        parameters,
        prediction,
        preview,
        retraction,
        tables,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "anatomy",
    "calibration",
    "cohort",
    "elastography",
    "ladder",
    "page",
    "parameters",
    "prediction",
    "preview",
    "retraction",
    "tables",
]
