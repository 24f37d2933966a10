# %% [markdown]
# # Two plans for one patient, and what we do not know
#
# **Question.** A deep target can be reached by one blade that pushes one wall aside, or by two that push both walls half as far.
# Which presses less in this patient, whose stiffness is known from waves to some 6 %, and whose tissue may be 1.5 times as stiff in
# a retraction as the waves say?
#
# **Numbers to reproduce.** The pressure of either plan is uncertain by more than a factor of **2.5** (95 %), the ratio of the
# two by less than **1.5**: most of what is not known is common to both plans. So the choice is **decided**; with draws made
# apart for each plan it would be **open**. The last cell checks this.

# %%
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import ngbrain as nb
from ngbrain.scene import Scene, Tissue
from ngbrain.surgery import Case

nb.set_threads(1)
FAST = bool(os.environ.get("NGBRAIN_FAST"))
folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## The patient
# A head, coarse and small; elastic tissue here, so that the lesson takes a minute: `ngbrain data twin` has one that relaxes. The
# map of |G*| at 50 Hz comes with its standard deviation; from a scanner, `nb.invert` makes both of measured waves.

# %%
base = Scene.shipped("idealised_fast")
base = replace(
    base,
    tissues=(
        Tissue(region="cortex", mu=1400.0, alpha=-19.0, bulk_to_shear_ratio=1000.0),
        Tissue(region="white", mu=750.0, alpha=-23.0, bulk_to_shear_ratio=1000.0),
        Tissue(region="ventricle.*", mu=50.0, bulk_to_shear_ratio=10.0),
    ),
    protocols=base.protocols[:1],
    mesh=replace(base.mesh, wall=8e-3, craniotomy=20e-3, largest=50e-3),
    tools=(replace(base.tool, travel=2e-3),),
    time=replace(base.time, ramp=2.0, end=4.0, step_tolerance=0.1),
)
(folder / "base.toml").write_text(base.to_toml(), encoding="utf-8")
nb.datasets.write("twin", folder)

# %% [markdown]
# ## The plans
# A plan is the base scene with other keys.

# %%
case = Case.from_dict(
    {
        "title": "One blade or two",
        "scene": str(folder / "base.toml"),
        "stiffness": {
            "map": str(folder / "twin_stiffness.nii.gz"),
            "sd": str(folder / "twin_stiffness_sd.nii.gz"),
            "frequency_Hz": 50.0,
        },
        "plan": [{"name": "one blade"}, {"name": "two blades", "tool": {"kind": "two spatulas"}}],
    }
)
result = nb.twin(case, draws=0 if FAST else 4, quick=FAST)
print("\n".join(result["conclusion"]))

# %% [markdown]
# ## Side by side

# %%
result.plot()

# %% [markdown]
# ## What is common to both plans
# Where the variance of a pressure comes from, and where that of the ratio of both.

# %%
PRESSURE = "peak_pressure_mmHg"
of_one = result["variance_shares"]["answers"]["one blade"][PRESSURE]
of_ratio = next(each for each in result["variance_shares"]["differences"] if each["measure"] == PRESSURE)["shares"]
for name, shares in (("pressure of one blade", of_one), ("ratio of the plans", of_ratio)):
    print(name, {source: round(share, 2) for source, share in list(shares.items())[:3]})

# %% [markdown]
# ## Check

# %%
low, high = result["answers"]["one blade"][PRESSURE]["interval_95"]
pair = next(each for each in result["differences"] if each["measure"] == PRESSURE)
near, far = pair["ratio_interval_95"]
apart = np.log(high / low) / 3.92 * np.sqrt(2)  # standard deviation of the ratio of draws made apart
print(
    f"pressure within a factor of {high / low:.2f}, ratio {pair['ratio_median']:.2f} within {far / near:.2f}: {pair['in_words']}"
)
assert high / low > 2.5 and far / near < 1.5
assert pair["decision"] == "two blades"
assert abs(np.log(pair["ratio_median"])) < 1.96 * apart, "draws made apart would leave it open"
