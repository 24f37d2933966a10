"""Complete jobs, from files to files, shared by the command line and Python.

The jobs themselves are `ngbrain.simulate`, `ngbrain.preview`, `ngbrain.mesh_head`, `ngbrain.twin`, `ngbrain.cohort`. Beside them:

- heads: `Subject`, `write_subject`
- cohorts: `read_list`, `CohortCase`; their results `Cohort`, `ResultRow`, `summarise`
- outliers: `find_outliers`, `Outlier`, `GroupStatistics`
- results: `TwinResult`, `main_numbers`, `write_inversion`, `write_maps`, `full_model`

Modules
-------
- `cohort`: Many scans or cases through one verb of the command line: one table and one report.
- `listing`: The list of a cohort, checked before the computation.
- `rows`: One row of a cohort, computed in its own folder.
- `summary`: The main numbers of a result.
- `results`: The rows with their verdicts, statistics, and the table.
- `gate`: Outlier detection over the rows.
- `subject`: Labels of a head with their source; `mesh_head`: from an image to a mesh.
- `doctor`: What an installation has, lacks and does slowly.
- `simulate`: A scene to its result; `preview`: a figure of the scene before.
- `twin`: One patient's surgical plans compared.
- `quick`: Coarse first answers before that.
- `property_maps`: The files of an inversion; `bids`: as a derivative dataset.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.workflows import (
        bids,
        cohort,
        doctor,
        gate,
        listing,
        mesh_head,
        preview,
        property_maps,
        quick,
        results,
        rows,
        simulate,
        subject,
        summary,
        twin,
    )
    from ngbrain.workflows.gate import GroupStatistics, Outlier, find_outliers
    from ngbrain.workflows.listing import CohortCase, read_list
    from ngbrain.workflows.mesh_head import write_subject
    from ngbrain.workflows.property_maps import write_inversion, write_maps
    from ngbrain.workflows.quick.search import full_model
    from ngbrain.workflows.results import Cohort, ResultRow, summarise
    from ngbrain.workflows.subject import Subject
    from ngbrain.workflows.summary import main_numbers
    from ngbrain.workflows.twin import TwinResult
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "Cohort",
    "CohortCase",
    "GroupStatistics",
    "Outlier",
    "ResultRow",
    "Subject",
    "TwinResult",
    "bids",
    "cohort",
    "doctor",
    "find_outliers",
    "full_model",
    "gate",
    "listing",
    "main_numbers",
    "mesh_head",
    "preview",
    "property_maps",
    "quick",
    "read_list",
    "results",
    "rows",
    "simulate",
    "subject",
    "summarise",
    "summary",
    "twin",
    "write_inversion",
    "write_maps",
    "write_subject",
]
