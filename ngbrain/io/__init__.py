"""Files in and out."""

from ngbrain.io.checkpoint import Checkpoint, Frame, load, save
from ngbrain.io.finished import FinishedWork
from ngbrain.io.json_file import write_json
from ngbrain.io.nodes import QuadraticGrid
from ngbrain.io.versions import show_versions, versions

__all__ = [
    "Checkpoint",
    "FinishedWork",
    "Frame",
    "QuadraticGrid",
    "load",
    "save",
    "show_versions",
    "versions",
    "write_json",
]
