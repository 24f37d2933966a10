"""One HTML page for each kind of result.

- `anatomy`: What a mesh of a head amounts to, as one page that opens alone: slices, surfaces, histograms, tables.
- `calibration`: How stiff a patient's tissues turned out to be, as one page that opens alone: factors, force,
  landmarks.
- `cohort`: What has come of a cohort, as one page that opens alone: verdicts, which numbers stand out, how they are
  spread.
- `elastography`: What an inversion of wave data amounts to, as one page that opens alone: waves and their fit, maps
  and truth, tables.
- `ladder`: What the cheapest adequate model says of a loaded body, as one page that opens alone: answers, what is
  left out, the way.
- `page`: Pages that open alone: a template of this folder, pictures inside of it.
- `parameters`: Words and tables of an inversion, for the page and for the terminal: names and units of parameters,
  starts, checks.
- `prediction`: What a trained operator makes of wave data, as one page that opens alone: whether to trust it, maps
  and truth, tables.
- `preview`: A scene before it is computed, as one page: geometry, regions, conditions, cleft and tool, on three
  slices and in space.
- `retraction`: What a retraction amounts to, as one page that opens alone: pictures, findings, tables.
- `tables`: The words and tables of the report: numbers as text, what each means and what was wanted of it.
"""

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
