"""Make idealised_head.vol.gz: the whole head (cortex, white matter, two ventricles), elements of 16 mm."""

from pathlib import Path

from ngbrain.mesh import Sizes, idealised_head

idealised_head(sizes=Sizes(far=16e-3)).ngmesh.Save(str(Path(__file__).with_name("idealised_head.vol.gz")))
