"""The lessons as notebooks: executed before, executed now, or shown without output."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import jupytext
import nbformat
import stage

EXECUTED = stage.ROOT / "out/notebooks"
"""Where lessons that are executed here are kept until they change."""


def add(pages: stage.Pages, folder: Path | None, execute: bool) -> None:
    """Stage every lesson.

    Parameters
    ----------
    pages : Pages
    folder : Path, optional
        Executed notebooks, as `.ci/notebook.py` writes them; the others are executed.
    execute : bool
        Without it the others are shown as they are, with a line that says so.
    """
    for lesson in stage.lesson_files():
        given = folder / f"{lesson.stem}.ipynb" if folder else None
        if given is None or not given.exists():
            given = executed(lesson) if execute else None
        notebook = nbformat.read(given, 4) if given else jupytext.read(lesson)
        prepare(pages, lesson, notebook, bool(given))


def executed(lesson: Path) -> Path:
    """Execute a lesson in its fast form, unless that was done since it changed."""
    path = EXECUTED / f"{lesson.stem}.ipynb"
    if not path.exists() or path.stat().st_mtime < lesson.stat().st_mtime:
        print(f"executing {lesson.name}", flush=True)
        runner = [sys.executable, str(stage.ROOT / ".ci/notebook.py"), str(lesson), str(EXECUTED)]
        if status := subprocess.run(runner, env={"NGBRAIN_FAST": "1"} | os.environ, check=False).returncode:
            path.unlink(missing_ok=True)
            sys.exit(status)
    return path


def prepare(pages: stage.Pages, lesson: Path, notebook: nbformat.NotebookNode, done: bool) -> None:
    """Stage a notebook to download, and its page: the same with a line under the title that says how to run it."""
    source, page = lesson.relative_to(stage.ROOT).as_posix(), f"lessons/{lesson.stem}.ipynb"
    notebook.metadata.setdefault("kernelspec", {"display_name": "Python 3", "language": "python", "name": "python3"})
    notebook.metadata.setdefault("language_info", {"name": "python"})
    pages.write(f"lessons/notebooks/{lesson.stem}.ipynb", nbformat.writes(notebook))
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = pages.relink(cell.source, source, page)
    state = "" if done else " Its outputs are left out: this site was built without executing lessons."
    how = f"{{download}}`This lesson as a notebook <notebooks/{lesson.stem}.ipynb>`; as a script `{source}`.{state}"
    title, _, rest = notebook.cells[0].source.partition("\n")
    notebook.cells[0].source = f"{title}\n\n{how}\n{rest}"
    pages.write(page, nbformat.writes(notebook))
