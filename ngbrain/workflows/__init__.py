"""Complete jobs, from files to files, shared by the command line and Python.

- `cohort`: Many scans or cases through one verb of the command line: one table and one report.
- `listing`: The list of a cohort, checked before the computation.
- `rows`: One row of a cohort, computed in its own folder.
- `summary`: The main numbers of a result.
- `results`: The rows with their verdicts, statistics, and the table.
- `gate`: Outlier detection over the rows.
- `mesh_head`: A head from an image to a mesh.
- `simulate`: A scene to its result; `preview`: a figure of the scene before.
- `property_maps`: The files of an inversion.
"""

__all__ = [
    "cohort",
    "gate",
    "listing",
    "mesh_head",
    "preview",
    "property_maps",
    "results",
    "rows",
    "simulate",
    "summary",
]
