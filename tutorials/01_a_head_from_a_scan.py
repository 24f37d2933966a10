# %% [markdown]
# # A head from a scan
#
# **Question.** What becomes of a T1 scan on its way to a mesh that can be operated on, and what is lost?
#
# **Number to reproduce.** The mesh's brain and ventricles have the volume of the scan's labels: **1868** and **18.7** ml
# (± 1 % and ± 5 %), whatever the size of the elements. The last cell checks it.
#
# The scan is the average of 152 people's (MNI152), without skull, as nilearn ships it; `read_scan("FILE.nii.gz")` reads
# one of your own, with its skull or without.

# %%
import os

import ngsolve as ngs
import numpy as np

import ngbrain
from ngbrain.image import mni152
from ngbrain.mesh import Sizes, smallest_angles
from ngbrain.scene import Scene
from ngbrain.surgery.heads import Scanned
from ngbrain.surgery.model import Model

FAST = bool(os.environ.get("NGBRAIN_FAST"))
ngbrain.set_threads(1)

# %% [markdown]
# ## The scan
# Axes are right, front, up; voxels are 1 mm; the affine takes voxel indices to metres.

# %%
scan = mni152()
print(scan.source, scan.volume.data.shape, f"{scan.volume.voxel_volume * 1e9:.2f} mm³ a voxel")

# %% [markdown]
# ## Tissues
# Five classes (fluid, grey, white and two mixtures) of one variance, with neighbours that prefer to agree. Ventricles are
# the fluid that lies deep, in large pieces, walled by white matter; their edge is where the grey value is half way from
# fluid to wall. It is done once: the labels are kept in a cache.

# %%
head = Scanned.of(scan)
volumes = head.describe(Model.of(Scene.shipped("demo_fast"), head).mesh)["label_volumes_ml"]
print({name: round(ml) for name, ml in volumes.items()}, "ml")

# %% [markdown]
# ## The opening and the mesh
# A target in the scan's own coordinates; the shortest way out; walls in exact planes; elements of 2 mm at the cleft, and
# grey or white matter at every quadrature point as the voxel there says.

# %%
cleft = head.cleft_to(np.array([24.0, -8.0, 40.0]) * 1e-3)
print(f"{1e3 * cleft.depth:.1f} mm deep, way out {np.round(cleft.out, 2)}")
sizes = Sizes(4e-3, 10e-3, 26e-3) if FAST else Sizes(2e-3, 6e-3, 8.9e-3)
mesh = head.opened(cleft, 40e-3, sizes)
print(mesh.ne, "tetrahedra;", mesh.GetMaterials(), set(mesh.GetBoundaries()))
corners = np.array([[mesh[v].point for v in element.vertices] for element in mesh.Elements()])
print(f"smallest angle between faces {smallest_angles(corners).min():.1f} degrees")

white = head.mixtures(mesh, order=2)["brain"]["white"]
share = ngs.Integrate(white * ngs.dx("brain", intrules=white.space.GetIntegrationRules()), mesh)
print(f"white matter at the quadrature points: {1e6 * share:.0f} ml, in the labels {volumes['white']:.0f} ml")

# %% [markdown]
# ## What is lost
# Gyri and sulci inside the hull: their fluid takes grey matter's law, and the surface between grey and white matter is
# as sharp as the quadrature points are dense.

# %% The number.
brain, ventricles = (
    1e6 * ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Materials(region)) for region in ("brain", "ventricles")
)
print(f"brain {brain:.0f} ml, ventricles {ventricles:.1f} ml")
assert abs(brain / 1868 - 1) < 0.01 and abs(ventricles / 18.7 - 1) < 0.05, (brain, ventricles)
