# %% [markdown]
# # A cohort: from one head to twelve
#
# **Question.** Twelve label maps have come for a study of how ventricles widen with age. Which of them can be used, which should be
# looked at first, and what does the study say?
#
# **Numbers to reproduce.** Every mesh holds the ventricles that its labels hold, within **2 %**. One person's ventricles are
# drawn three times as wide as others': that row alone stands out. One file has been cut short: that row alone fails. The
# last cell checks this.

# %%
import csv
import os
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import nibabel
import numpy as np
from scipy import ndimage

import ngbrain
from ngbrain.image import tissue_maps

ngbrain.set_threads(1)
FAST = bool(os.environ.get("NGBRAIN_FAST"))
folder = Path(tempfile.mkdtemp())
VOXEL, SIZE = 3.0, 24.0 if FAST else 12.0  # mm, of images and elements
PEOPLE = 8 if FAST else 12

# %% [markdown]
# ## Twelve people
# Made up, so that the truth is known: MNI152's maps of fluid, grey and white matter, each brain of another size, its ventricles
# widened from their middle. The wider, the older, with a spread between people; `odd` is the one that does not belong.


# %%
def labelled(random: np.random.Generator, widened: float) -> nibabel.Nifti1Image:
    """Fluid 1, grey matter 2, white matter 3 and ventricles 4 of a person."""
    axes = [np.arange(low, high, VOXEL) for low, high in ((-84, 84), (-120, 90), (-80, 92))]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) / np.exp(random.normal(-0.05, 0.03, 3))
    away = places - [0, -12, 12]
    near = np.exp(-((away / [30, 50, 30]) ** 2).sum(axis=-1) / 2)
    there = places - widened * near[..., None] * away
    shares = np.stack(
        [each.interpolate(1e-3 * there.reshape(-1, 3)).reshape(there.shape[:3]) for each in tissue_maps()]
    )
    labels = np.where(shares.sum(axis=0) > 0.5, 1 + shares.argmax(axis=0), 0).astype(np.int16)
    deep = (labels == 1) & ((((there - [0, -12, 12]) / [32, 48, 24]) ** 2).sum(axis=-1) < 1)
    pieces, _ = ndimage.label(deep)
    labels[pieces == 1 + np.bincount(pieces.ravel())[1:].argmax()] = 4
    affine = np.diag([VOXEL, VOXEL, VOXEL, 1.0])
    affine[:3, 3] = [axis[0] for axis in axes]
    image = nibabel.Nifti1Image(labels, affine)
    image.header.set_xyzt_units("mm")
    return image


random = np.random.default_rng(14)
ages = {f"p{i:02}": age for i, age in enumerate(random.integers(25, 80, PEOPLE - 1))} | {"odd": 41}
truth = {}
for name, age in ages.items():
    widened = 1.1 if name == "odd" else 0.003 * (age - 25) + abs(random.normal(0, 0.02))
    image = labelled(random, widened)
    nibabel.save(image, folder / f"{name}.nii.gz")
    truth[name] = float((np.asarray(image.dataobj) == 4).sum()) * 1e-3 * VOXEL**3  # ml
print({name: round(volume, 1) for name, volume in truth.items()})

# %% [markdown]
# ## One head
# The job is a table: what to call a row, which file it takes, and a column for every option of the verb, here `mesh`. What is no
# option, as `age`, is kept. `ngbrain cohort --template` prints such a table with comments, and
# `ngbrain cohort study.csv --verb mesh -o study` does from a terminal what follows.

# %%
COLUMNS = ("name", "input", "labels", "names", "route", "size", "age")
NAMES = "1=csf,2=grey,3=white,4=ventricles"
study = folder / "study.csv"


def write_list(names: list[str]) -> None:
    """The table of these people."""
    with open(study, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for name in names:
            table.writerow([name, f"{name}.nii.gz", "yes", NAMES, "conforming", SIZE, ages[name]])


write_list(["p00"])
one = ngbrain.cohort(study, folder / "study", "mesh", executor=None)  # in this process
print(one)
print({key: round(number.value, 2) for key, number in one.rows[0].numbers.items()})

# %% [markdown]
# ## Twelve
# More rows, the same call. What is finished is known by the contents of its files, its options and the code: only the new
# ones are computed, two at a time. A row that fails says why, and the others go on.

# %%
whole = (folder / "p03.nii.gz").read_bytes()
(folder / "p03.nii.gz").write_bytes(whole[: len(whole) // 2])
write_list(list(ages))
twelve = ngbrain.cohort(study, folder / "study", "mesh", executor=2)
print(twelve)
print("computed now:", sum(row.computed for row in twelve.rows))
for row in twelve.rows:
    if row.verdict != "ok":
        print(f"{row.name}: {row.verdict}: {row.reason}")
failed = [row.name for row in twelve.rows if row.verdict == "failed"]

# %% [markdown]
# The file comes again, whole, and the same call does this row alone.

# %%
(folder / "p03.nii.gz").write_bytes(whole)
twelve = ngbrain.cohort(study, folder / "study", "mesh", executor=2)
print(twelve)
print("computed now:", [row.name for row in twelve.rows if row.computed])

# %% [markdown]
# ## On a cluster
# The rows go to whatever has the interface of `concurrent.futures`: here to a Dask cluster of two workers on this machine. Of
# a real one, the client has its address. The job is the same table and the same call, and the results are the same, to the
# bit. From a terminal it is `--executor dask:ADDRESS`.

# %%
try:
    from distributed import Client
    from distributed.deploy.subprocess import SubprocessCluster
except ImportError:
    print("Dask is not installed, so this cell is left out: pip install distributed")
else:
    write_list(["p00", "p01"])
    with (
        SubprocessCluster(n_workers=2, worker_kwargs={"nthreads": 1}, silence_logs=40) as cluster,
        Client(cluster) as client,
    ):
        client.wait_for_workers(2, timeout=120)
        there = ngbrain.cohort(study, folder / "cluster", "mesh", executor=client)
    print(there)
    for row, other in zip(there.rows, twelve.rows[:2], strict=True):
        assert row.numbers == other.numbers, row.name

# %% [markdown]
# ## What the study says
# `report.html` in the folder has this for every number, with links to the reports of the rows. Left: the distance of each number
# from the median of the cohort, over the limit, which is set so that one in twenty cohorts of normal people would have a single row
# beyond it. Right: what was asked.

# %%
figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
tested = [spread for spread in twelve.spreads if not spread.untested]
for at, spread in enumerate(tested):
    for name, value in twelve.values(spread.key).items():
        away = spread.deviation(value) / spread.limit
        axes[0].plot(away, at, "D" if abs(away) > 1 else "o", color="C1" if abs(away) > 1 else "C0", alpha=0.7)
        if abs(away) > 1:
            axes[0].annotate(name, (away, at), xytext=(-8, 0), textcoords="offset points", ha="right", va="center")
for limit in (-1, 1):
    axes[0].axvline(limit, color="tab:red", ls="--", lw=1)
axes[0].set_yticks(range(len(tested)), [spread.key for spread in tested])
axes[0].set(xlabel="distance from the median / limit", ylim=(-0.6, len(tested) - 0.4))
volumes = twelve.values("volume_ml_ventricles")
out = {each.row for each in twelve.outliers}
for name, volume in volumes.items():
    axes[1].plot(ages[name], volume, "D" if name in out else "o", color="C1" if name in out else "C0")
    axes[1].plot(ages[name], truth[name], "k+", ms=10)
axes[1].plot([], [], "k+", label="in the labels")
axes[1].plot([], [], "o", color="C0", label="in the mesh")
axes[1].set(xlabel="age", ylabel="ventricles (ml)")
axes[1].legend(frameon=False)
plt.show()
within = [name for name in ages if name not in out]
slope, level = np.polyfit([ages[name] for name in within], [volumes[name] for name in within], 1)
print(f"ventricles widen by {10 * slope:.1f} ml in ten years, without {', '.join(out)}")

# %% The numbers.
off = {name: volume / truth[name] - 1 for name, volume in volumes.items()}
print("farthest off:", max(off.items(), key=lambda each: abs(each[1])))
assert failed == ["p03"]
assert out == {"odd"}
assert len(volumes) == PEOPLE and max(map(abs, off.values())) < 0.02, off
print("reproduced")
