"""Files in and out."""

from ngbrain.io.checkpoint import Checkpoint, Frame, load, save
from ngbrain.io.json_file import write_json
from ngbrain.io.nodes import QuadraticGrid

__all__ = ["Checkpoint", "Frame", "QuadraticGrid", "load", "save", "write_json"]
