"""Make block.vol.gz: 60 × 60 × 40 mm of tissue, elements of 10 mm."""

from pathlib import Path

from ngbrain.mesh import block

block().ngmesh.Save(str(Path(__file__).with_name("block.vol.gz")))
