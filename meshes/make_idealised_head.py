"""Make idealised_head.vol.gz: the whole head (cortex, white matter, two ventricles), elements of 18 mm."""

from pathlib import Path

from ngbrain.mesh import Sizes, idealised_head

idealised_head(sizes=Sizes(far=18e-3, grading=0.5)).ngmesh.Save(str(Path(__file__).with_name("idealised_head.vol.gz")))
