"""Execute a tutorial as a notebook, from a folder that knows nothing of it; fail where a cell fails or none draws.

usage: notebook.py TUTORIAL.py FOLDER

Writes FOLDER/TUTORIAL.ipynb with all outputs, and its pictures as FOLDER/TUTORIAL-1.png and so on.
"""

from __future__ import annotations

import base64
import os
import sys
import tempfile
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from traitlets.config import Config


def outputs(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    """What the cells gave, in order."""
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def pictures(notebook: nbformat.NotebookNode) -> list[bytes]:
    """Every PNG that a cell shows."""
    shown = [output.data for output in outputs(notebook) if output.output_type in ("display_data", "execute_result")]
    return [base64.b64decode(data["image/png"]) for data in shown if "image/png" in data]


def main(tutorial: Path, folder: Path) -> None:
    """Execute, write, look for pictures; exit with status 1 where something is missing."""
    notebook = jupytext.read(tutorial)
    os.environ.pop("MPLBACKEND", None)  # the kernel's own shows pictures
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as own:
        # Over sockets of its own: two kernels that start at once may choose the same port.
        sockets = Config(ConnectionFileMixin={"transport": "ipc", "ip": f"{own}/kernel"})
        place = {"metadata": {"path": own}}
        client = NotebookClient(notebook, kernel_name="python3", startup_timeout=300, resources=place, config=sockets)
        try:
            client.execute()
        except CellExecutionError as error:
            text = "".join(output.text for output in outputs(notebook) if output.output_type == "stream")
            sys.exit(f"{text}\n{error}")
        finally:
            nbformat.write(notebook, folder / f"{tutorial.stem}.ipynb")
    drawn = pictures(notebook)
    for number, picture in enumerate(drawn, 1):
        (folder / f"{tutorial.stem}-{number}.png").write_bytes(picture)
    if not drawn:
        sys.exit(f"{tutorial} draws nothing")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
