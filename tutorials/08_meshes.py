# %% [markdown]
# # Meshes of a head: how much anatomy, at what price
#
# **Question.** The same labels can become a hull with tissue as a field inside, a lattice that follows every tissue, or a
# mesh whose triangles are the tissues' surfaces. What does each get right, and what does it cost?
#
# **Number to reproduce.** Whatever the route, the mesh has the volumes of its labels: a ball of white matter in grey matter
# with ventricles in it, **grey 154.8, white 105.8, ventricles 7.1 ml**, within 5 %. The last cell checks it.
#
# The pictures of a head are made by `ngbrain.viz`, which needs the extra `viz`: `pip install "ngbrain[demo,viz]"`.

# %%
import os
import tempfile
import time
from pathlib import Path

import matplotlib.pyplot as plt
import ngsolve as ngs
import numpy as np
from matplotlib.colors import to_rgb

import ngbrain
from ngbrain import viz
from ngbrain.image import LabelMap, Volume, label_tissues, landmarks, mni152
from ngbrain.io import read_mesh, write_mesh
from ngbrain.mesh import (
    ROUTES,
    Indicators,
    Quality,
    RadialSizeField,
    cortex,
    deviations,
    mesh_elements,
    volumes_ml,
    voxelise,
)

FAST = bool(os.environ.get("NGBRAIN_FAST"))
ngbrain.set_threads(1)

# %% [markdown]
# ## Labels
# A map of labels is integers on voxels with a place in the world, and a name for every number. `read_labels("aseg.mgz")`
# reads one from FreeSurfer or SPM, `tissues(read_scan("T1.nii.gz"))` makes one of a scan; here it is balls in balls.

# %%
x = np.stack(np.meshgrid(*[np.arange(-46, 47)] * 3, indexing="ij"), axis=-1)
away = np.linalg.norm(x, axis=-1)
affine = np.diag([1e-3, 1e-3, 1e-3, 1.0])
affine[:3, 3] = -46e-3
numbers = (away < 40).astype(int) + (away < 30) + (away < 12)
balls = LabelMap(Volume(numbers, affine), {1: "grey", 2: "white", 3: "ventricles"})
print({name: round(ml, 1) for name, ml in balls.volumes_ml().items()}, "ml")

# %% [markdown]
# ## Three routes
# Each takes labels and a size field, any function of points. `deviations` says how far an interface is from where the
# labels' smoothed shares are equal; a hull has none between grey and white.

# %%
indicators = Indicators.of(balls)
made = {}
for route in ROUTES:
    start = time.process_time()
    made[route] = mesh_elements(balls, route, RadialSizeField(5e-3, 5e-3))
    quality = Quality.of(made[route]).summary()
    told = deviations(made[route], indicators) if route != "hull" else {}
    off = f"{1e3 * np.concatenate(list(told.values())).mean():.2f} mm" if told else "not followed"
    print(
        f"{route:<11}{quality['n_tets']:7d} tetrahedra, smallest angle {quality['min_dihedral_deg']:4.1f}°, "
        f"tissue interfaces: {off}, {time.process_time() - start:.1f} s, {made[route].regions}"
    )

# %% [markdown]
# The middle plane through the three meshes. Each colour is a region, each shade an element. The hull has one region for grey and
# white matter together; they are a field in it.

# %%
line = np.linspace(-0.042, 0.042, 400)
points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
colours = {"grey": "#a5a5a5", "white": "#f0e5c8", "ventricles": "#3a8fc7", "brain": "#d8b9a0"}
figure, axes = plt.subplots(1, 3, figsize=(10, 3.4), layout="constrained", sharey=True)
for ax, (route, elements) in zip(axes, made.items(), strict=True):
    mesh = elements.mesh()
    number = mesh(points[:, 0], np.full(len(points), 1e-4), points[:, 1])["nr"]
    regions = np.array([to_rgb(colours[element.mat]) for element in mesh.Elements()])
    shades = regions * np.random.default_rng(0).uniform(0.75, 1, (mesh.ne, 1))
    picture = np.where(number[:, None] < 0, 1.0, shades[number]).reshape(len(line), len(line), 3)
    ax.imshow(picture, origin="lower", extent=[-42, 42, -42, 42])
    ax.set(title=f"{route}: {', '.join(elements.regions)}", xlabel="x (mm)")
axes[0].set_ylabel("z (mm)")
plt.show()

# %% [markdown]
# ## Fine where it is asked for
# 2 mm around a site, 8 mm away from it.

# %%
site = (0.0, 0.0, 0.03)
fine = mesh_elements(balls, "hull", RadialSizeField(2e-3, 8e-3, site, radius=5e-3))
size = np.cbrt(8.5 * np.abs(fine.volumes()))
near = np.linalg.norm(fine.points[fine.tets].mean(axis=1) - site, axis=1) < 8e-3
print(
    f"{len(fine.tets)} tetrahedra, {1e3 * size[near].mean():.1f} mm at the site, {1e3 * size[~near].mean():.1f} mm elsewhere"
)

# %% [markdown]
# ## A real head
# The template's labels by the route that is chosen for surgery, and where things are in it.

# %%
brain = label_tissues(mni152()).labels
head = mesh_elements(brain, "hull", RadialSizeField(9e-3, 9e-3) if FAST else None)
print(len(head.tets), "tetrahedra", {name: round(ml, 1) for name, ml in volumes_ml(head).items()}, "ml")
places = landmarks(brain)
print({name: (1e3 * places[name]).round().tolist() for name in ("front", "left ventricle", "right ventricle")}, "mm")

# %% [markdown]
# Slices of the scan with its labels, and of the mesh, through the left ventricle; then the mesh to turn with the mouse.

# %%
viz.slices(head, brain, mni152().volume, at=places["left ventricle"])

# %%
viz.interactive(head.mesh(), at=places["left ventricle"])

# %% [markdown]
# ## The cortex as surfaces
# Closed, one in the other and without crossings; `spherical_cortex` cuts the handles that labels of a real head have.
# Here the cortex lies between radii of 30 and 20 mm.

# %%
small = (away < 30).astype(int) + (away < 20) + (away < 8)
sheet = cortex(LabelMap(Volume(small, affine), balls.names))
for name, surface in sheet.surfaces.items():
    print(f"{name:<11}{1e4 * surface.area:7.1f} cm², {1e6 * surface.volume:6.1f} ml, genus {surface.genus}")
print(f"thickness {1e3 * sheet.thickness.mean():.2f} mm")

# %% [markdown]
# ## In and out
# NGSolve's mesh, voxels of any grid, and other programs' files.

# %%
mesh = head.mesh()
print(mesh.GetMaterials(), set(mesh.GetBoundaries()), f"{1e6 * ngs.Integrate(ngs.CF(1), mesh):.1f} ml")
back, _, _ = voxelise(head, brain.volume.affine, brain.volume.data.shape)
print(f"back on the scan's voxels: {back.voxel_volume * 1e6 * (back.data > 0).sum():.1f} ml")
with tempfile.TemporaryDirectory() as folder:
    write_mesh(Path(folder) / "head.msh", head)
    print("Gmsh:", read_mesh(Path(folder) / "head.msh").regions)

# %% The numbers.
assert abs(sheet.thickness.mean() - 0.010) < 1e-4
wanted = balls.volumes_ml()
assert np.allclose(list(wanted.values()), [154.8, 105.8, 7.1], atol=0.1)
for route, elements in made.items():
    found = volumes_ml(elements)
    if route == "hull":
        wanted_here = {"brain": wanted["grey"] + wanted["white"], "ventricles": wanted["ventricles"]}
    else:
        wanted_here = wanted
    errors = {name: found[name] / ml - 1 for name, ml in wanted_here.items()}
    print(route, {name: f"{error:+.2%}" for name, error in errors.items()})
    assert all(abs(error) < 0.05 for error in errors.values())
