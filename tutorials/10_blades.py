# %% [markdown]
# # Blades: one, two, a tube
#
# **Question.** A cleft is opened by the same two millimetres with one spatula, with two that share the way, with a tube, with a
# spatula that narrows towards its tip and with one that bulges. Which presses least, and where?
#
# **Numbers to reproduce.** Mean pressure on the wall, of one spatula's: two spatulas **0.38**, a tube **0.20** (each within
# 5 %). The last cell checks both. (The other two: 0.9 and 0.7, where they are computed.)

# %%
import os
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import ngbrain
from ngbrain.forward import StepControl
from ngbrain.scene import Scene
from ngbrain.surgery import Observer, RetractionModel
from ngbrain.units import to_mm, to_mmHg

ngbrain.set_threads(1)
FAST = bool(os.environ.get("NGBRAIN_FAST"))

# %% [markdown]
# ## A scene and its blade
# The idealised head with coarse elements; everything but `[[tool]]` stays as it is. In a scene file the five are
# `kind = "spatula"`, `"two spatulas"` and `"tube"`, `tip_width_mm = 6` and `face_radius_mm = 60`. `travel_mm` is what is opened
# in all: two spatulas go half of it each, and a tube's radius grows by half of it.

# %%
scene = Scene.shipped("idealised_fast")
scene = replace(
    scene,
    mesh=replace(scene.mesh, wall=5e-3, craniotomy=16e-3, largest=40e-3),
    tools=(replace(scene.tool, travel=2e-3),),
)
blades = {
    "one spatula": {},
    "two spatulas": {"kind": "two spatulas"},
    "tube": {"kind": "tube"},
    "narrow tip": {"tip_width": 6e-3},
    "bulging": {"face_radius": 60e-3},
}
if FAST:
    blades = {name: blades[name] for name in ("one spatula", "two spatulas", "tube")}

# %% [markdown]
# ## Open
# Elastic tissue is enough for a comparison of shapes: as stiff as one that relaxes for the ten seconds of the opening. Then the
# way there does not matter, and few steps serve.


# %%
def opened(blade):
    """What is read at full opening."""
    model = RetractionModel.from_scene(replace(scene, tools=(replace(scene.tool, **blade),)))
    seconds, way = scene.time.ramp, scene.tool.travel
    run = model.run(model.ramp("open"), StepControl(seconds / 2, first=0.05), model.elastic_materials(seconds))
    run.run(lambda *_: None)
    return Observer(run.problem, model.blades, model.fixed)(seconds, way, 1.0)


read = {name: opened(blade) for name, blade in blades.items()}
print("              mean    tip   centre (mmHg)   force (N)   wall has gone (mm)")
for name, row in read.items():
    pressures = [to_mmHg(p) for p in (row.pressure, row.tip_pressure, row.centre_pressure)]
    mean, tip, centre = pressures
    print(f"{name:<13}{mean:5.1f}  {tip:5.1f}    {centre:5.1f}{row.force:19.2f}{to_mm(row.opening):17.2f}")

# %% [markdown]
# Two spatulas and a tube lower the pressure. Two spatulas each strain their wall half as much: linear tissue would press half as
# hard, this one stiffens, and the ratio is less than half. A tube touches the walls halfway along first and bends them around it:
# the pressure is a mean over a patch that has gone 1.4 mm, not 2. Its pressure is highest in the middle, a spatula's at the tip. A
# tip of 6 instead of 10 mm, and a face that bulges, move less wall at the tip and press less there.
#
# What this does not say: a second spatula presses a wall that one alone leaves in peace. Pressure in the middle of the face, 5 mm
# across, is read off one or two elements here. And it is one opening of one coarse head in elastic tissue: `ngbrain simulate` with
# a `[[tool]]` of your own, on your mesh, gives pressures over time and injury measures.

# %%
at = np.arange(len(read))
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for k, (key, label) in enumerate({"pressure": "mean", "tip_pressure": "last 5 mm at the tip"}.items()):
    values = [to_mmHg(getattr(row, key)) for row in read.values()]
    bars = axes.bar(at + 0.4 * (k - 0.5), values, 0.38, color=("#0072B2", "#E69F00")[k], label=label)
    axes.bar_label(bars, fmt="%.1f", fontsize=9)
axes.set_xticks(at, list(read))
axes.set(ylabel="pressure on the wall (mmHg)", title="Opened by 2 mm")
axes.spines[["top", "right"]].set_visible(False)
axes.legend(frameon=False)
plt.show()

# %% The numbers.
two, tube = (read[name].pressure / read["one spatula"].pressure for name in ("two spatulas", "tube"))
print(f"of one spatula's pressure: two spatulas {two:.3f}, tube {tube:.3f}")
assert abs(two / 0.38 - 1) < 0.05 and abs(tube / 0.20 - 1) < 0.05, (two, tube)
