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

import matplotlib.pyplot as plt
import ngsolve as ngs
import numpy as np

import ngbrain
from ngbrain.image import mni152, segment
from ngbrain.mesh import Sizes, smallest_angles
from ngbrain.scene import Scene
from ngbrain.surgery import RetractionModel, ScannedHead

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
head = ScannedHead.from_scan(scan)
volumes = head.describe(RetractionModel.from_scene(Scene.shipped("demo_fast"), head).mesh)["label_volumes_ml"]
print({name: round(ml) for name, ml in volumes.items()}, "ml")

# %% [markdown]
# ## The opening and the mesh
# A target in the scan's own coordinates; the shortest way out; walls in exact planes; elements of 2 mm at the cleft, and
# grey or white matter at every quadrature point as the voxel there says.

# %%
cleft = head.cleft_to(np.array([24.0, -8.0, 40.0]) * 1e-3)
print(f"{1e3 * cleft.depth:.1f} mm deep, way out {np.round(cleft.out, 2)}")
sizes = Sizes(4e-3, 10e-3, 26e-3) if FAST else Sizes(2e-3, 6e-3, 8.9e-3)
mesh = head.open_cleft(cleft, 40e-3, sizes)
print(mesh.ne, "tetrahedra;", mesh.GetMaterials(), set(mesh.GetBoundaries()))
corners = np.array([[mesh[v].point for v in element.vertices] for element in mesh.Elements()])
print(f"smallest angle between faces {smallest_angles(corners).min():.1f} degrees")

white = head.mixtures(mesh, order=2)["brain"]["white"]
share = ngs.Integrate(white * ngs.dx("brain", intrules=white.space.GetIntegrationRules()), mesh)
print(f"white matter at the quadrature points: {1e6 * share:.0f} ml, in the labels {volumes['white']:.0f} ml")

# %% [markdown]
# ## In one picture
# The coronal plane through the target: the scan, its labels, and the elements that the plane cuts.

# %%
t1, labels, affine = scan.volume.data, head.labels.data, scan.volume.affine
spacing, origin = 1e3 * scan.volume.spacing[0], 1e3 * affine[:3, 3]
x, z = (origin[k] + spacing * np.arange(t1.shape[k]) for k in (0, 2))
layer = round((1e3 * cleft.target[1] - origin[1]) / spacing)
edges = [x[0] - spacing / 2, x[-1] + spacing / 2, z[0] - spacing / 2, z[-1] + spacing / 2]
points = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2) / 1e3
number = mesh(points[:, 0], np.full(len(points), cleft.target[1]), points[:, 1])["nr"].reshape(len(z), len(x))
shade = np.random.default_rng(0).random(mesh.ne)[number]

figure, axes = plt.subplots(1, 3, figsize=(10, 4.4), layout="constrained", sharey=True)
axes[0].imshow(t1[:, layer].T, cmap="gray", origin="lower", extent=edges)
kinds = axes[1].imshow(
    labels[:, layer].T, cmap=plt.get_cmap("viridis", 5), vmin=-0.5, vmax=4.5, origin="lower", extent=edges
)
axes[2].imshow(np.where(number < 0, np.nan, shade), cmap="Blues", vmin=-0.2, vmax=1.2, origin="lower", extent=edges)
bar = figure.colorbar(kinds, ax=axes[1], ticks=range(5), location="bottom")
bar.ax.set_xticklabels(segment.tissue_classes.NAMES, fontsize=8)
way = np.array([cleft.target, cleft.entry]) * 1e3
for ax, title in zip(axes, ("T1", "tissue labels", "elements"), strict=True):
    ax.plot(way[:, 0], way[:, 2], color="tab:red")
    ax.set(title=title, xlabel="x, to the right (mm)", xlim=(-80, 80), ylim=(-80, 90))
axes[0].set_ylabel("z, up (mm)")
figure.suptitle(f"y = {1e3 * cleft.target[1]:.0f} mm; red: the way to the target")
plt.show()

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
