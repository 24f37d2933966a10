# %% [markdown]
# # Any energy: from large deformations and from time to what tissue is made of
#
# **Question.** Tissue was pressed and sheared by a fifth of its size, far beyond where it is linear. How stiff is it, where, and
# how sure is that? And what of a law that is in no book?
#
# **Numbers to reproduce.** A law of one's own, k = .8 and μ that rises by half, from 1 % noise: k = **0.78** (± 0.07), μ within
# **6 %**. A disc of 3 kPa in a block of 1 kPa, from displacements and plate forces with 1 % noise: contrast **2.7** (± 0.2).
# Relaxation from one force curve with 1 % noise: g = **0.45** (± 0.02) and τ = **4.0** s (± 0.3). The last cell checks them.
# (Smoothing takes some of the contrast of what is sharp.)

# %%
import os
from dataclasses import dataclass

import matplotlib.pyplot as plt
import netgen.occ as occ
import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh

import ngbrain
from ngbrain.adjoint import taylor
from ngbrain.forward import (
    Displacements,
    Force,
    LinearObservable,
    LoadCase,
    LoadPath,
    Material,
    Observable,
    Problem,
    RigidContact,
    RunModel,
    StaticModel,
    StrainPercentile,
)
from ngbrain.inverse import estimate
from ngbrain.materials import Law, NeoHooke, Prony
from ngbrain.mesh import block
from ngbrain.surgery import Drive, ToolMotion

ngbrain.set_threads(1)
FAST = bool(os.environ.get("NGBRAIN_FAST"))
rng = np.random.default_rng(1)

# %% [markdown]
# ## A law of one's own
# A law is an energy. Nobody writes its stress, its tangent or how either changes with a parameter: they are derived. This one
# stiffens with the fourth power of the strain.


# %%
@dataclass(frozen=True)
class Quartic(Law):
    """W = μ/2 (I₁ - 3) + μ k (I₁ - 3)²."""

    mu: ngs.CoefficientFunction
    k: ngs.CoefficientFunction

    def energy(self, C):
        """W(C̄)."""
        beyond = ngs.Trace(C) - 3
        return self.mu / 2 * beyond + self.mu * self.k * beyond**2


def pressed(mesh, law, form="P2/P1"):
    """A block between plates: pressed by 15 %, and sheared by 20 %."""
    tissue = {".*": Material(law, bulk=5e4)}
    down, aside = (0.0,) * (mesh.dim - 1) + (-0.015,), (0.02,) + (0.0,) * (mesh.dim - 1)
    return [Problem(mesh, tissue, {"bottom": 0, "top": way}, element=form) for way in (down, aside)]


def grid(n):
    """Points in the block."""
    line = (np.arange(n) + 0.5) * 0.1 / n
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


n = 14
points = grid(n)
coarse = MakeStructured2DMesh(quads=False, nx=n, ny=n, mapping=lambda x, y: (0.1 * x, 0.1 * y))


def seen(bodies, parameters):
    """Displacements at the points and the force on the plate, of both loads."""
    return StaticModel([LoadCase(body, [Displacements(points), Force("top")]) for body in bodies], parameters)


mu, k = ngs.GridFunction(ngs.H1(coarse, order=1)), ngs.Parameter(0.5)
mu.Set(1000 + 500 * ngs.sin(50 * ngs.x))
model = seen(pressed(coarse, Quartic(mu, k)), {"mu": mu, "k": k})
theta, w = model.theta, rng.normal(size=len(model.evaluate(model.theta).data))
direction = theta * rng.normal(size=model.size)
rates = taylor(lambda x: float(w @ model.evaluate(x).data), model.evaluate(theta).gradient(w), theta, 5 * direction)
print(f"{model.size} parameters, one adjoint solve for each load; the remainder falls with the rates {rates.round(3)}")

# %% [markdown]
# A rate of 2 says that the gradient is right. It took one solve with the transposed tangent for each load, however many the
# parameters are.
#
# What can be differentiated can be inverted. Data of this law with k = .8 in tissue whose μ rises from 800 to 1200 Pa, from a
# finer mesh of higher order, with 1 % of noise; nothing is told but the energy, what was seen, and how noisy it is.

# %%
finer = MakeStructured2DMesh(quads=False, nx=9, ny=9, mapping=lambda x, y: (0.1 * x, 0.1 * y))
rising = 800 + 4000 * ngs.x
exact = seen(pressed(finer, Quartic(rising, ngs.CF(0.8)), "P3/P2"), {"none": ngs.Parameter(0.0)})
data = exact.evaluate(exact.theta).data
for where in exact.observation_slices:
    data[where] += 0.01 * np.sqrt(np.mean(data[where] ** 2)) * rng.normal(size=where.stop - where.start)
mu.Set(1500.0)
own = estimate(model, data, noise=0.01)
wrong = np.sqrt(ngs.Integrate((mu / rising - 1) ** 2, coarse) / 0.01)
bar = own.posterior.interval("k")
print(f"μ is off by {wrong:.1%}; k = {k.Get():.3f}, 95 % between {bar.low[0]:.3f} and {bar.high[0]:.3f}; .8 in truth")

# %% [markdown]
# ## Stiffness from large deformations
# The truth is made on another mesh, which knows the disc, with elements of third order. The inversion knows neither. Noise is
# 1 % of the displacements and of the forces, and elements that do not know where the disc ends miss .5 % more: that has to be said,
# or noise would be looked for in the field. How much the field is smoothed follows from both.


# %%
def simulated():
    """Data without noise, from another mesh and order."""
    whole, disc = occ.Rectangle(0.1, 0.1).Face(), occ.Circle(occ.Pnt(0.055, 0.05), 0.022).Face()
    whole.edges.Min(occ.Y).name, whole.edges.Max(occ.Y).name = "bottom", "top"
    disc.faces.name = "disc"
    fine = ngs.Mesh(occ.OCCGeometry(occ.Glue([whole - disc, disc]), dim=2).GenerateMesh(maxh=0.012 if FAST else 0.008))
    truth = fine.MaterialCF({"disc": 3000.0}, default=1000.0)
    model = seen(pressed(fine, NeoHooke(truth), "P3/P2"), {"none": ngs.Parameter(0.0)})
    return model.evaluate(model.theta).data


clean = simulated()
size = np.empty_like(clean)
for load in np.split(np.arange(len(clean)), 2):
    moved, force = load[:-2], load[-2:]
    size[moved] = np.sqrt(2 * np.mean(clean[moved] ** 2))
    size[force] = np.linalg.norm(clean[force])
data = clean + 0.01 * size * rng.normal(size=len(clean))
sigma = np.hypot(0.01, 0.005) * size  # noise, and what elements that do not know the disc miss

mu.Set(1500.0)
model = seen(pressed(coarse, NeoHooke(mu)), {"mu": mu})
found = estimate(model, data, sigma)  # and mu is what was found
there = mu(coarse(*points.T)).ravel()
inside = np.linalg.norm(points - [0.055, 0.05], axis=1) < 0.022
contrast = np.median(there[inside]) / np.median(there[~inside])
print(f"contrast {contrast:.2f} (3 in truth), misfit {found.misfit:.2f} of what noise leaves; {model.solves}")

# %% [markdown]
# ## How sure is that?
# Around what was found the misfit is a parabola, as far as data tell; where they do not, the regulariser's own assumption holds.
# Both together are error bars, for the price of two solves for each number that the data determine.

# %%
posterior = found.posterior
band = posterior.interval("mu")
vertices = np.array([vertex.point for vertex in coarse.vertices])
for name, place in (("in the disc", (0.05, 0.05)), ("beside it", (0.02, 0.05))):
    i = int(np.argmin(np.linalg.norm(vertices - place, axis=1)))
    print(f"{name}: {band.value[i]:.0f} Pa, 95 % between {band.low[i]:.0f} and {band.high[i]:.0f}")
print(f"data say more than was assumed along {len(posterior.informed_directions)} of {len(found.x)} directions")
truth = np.where(np.linalg.norm(vertices - [0.055, 0.05], axis=1) < 0.022, 3000.0, 1000.0)
held = (band.low < truth) & (truth < band.high)
far = np.abs(np.linalg.norm(vertices - [0.055, 0.05], axis=1) - 0.022) > 0.01
print(
    f"of all bands {held.mean():.0%} hold the truth, of those 1 cm and more from the disc's edge {held[far].mean():.0%}"
)

figure, axes = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained", width_ratios=(1, 1.3))
triangles = [[v.nr for v in element.vertices] for element in coarse.Elements()]
colours = axes[0].tripcolor(*(1e3 * vertices).T, triangles, band.value / 1e3, shading="gouraud", vmin=0.5, vmax=3.5)
axes[0].add_patch(plt.Circle((55, 50), 22, fill=False, color="white"))
axes[0].set(title="found; circle: the disc", xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
figure.colorbar(colours, ax=axes[0], label="μ (kPa)")
across = np.flatnonzero(np.abs(vertices[:, 1] - 0.05) < 1e-6)
across = across[np.argsort(vertices[across, 0])]
x, ends = 1e3 * vertices[across, 0], np.stack([band.low[across], band.high[across]]) / 1e3
axes[1].fill_between(x, *ends, alpha=0.3, label="95 % interval")
axes[1].plot(x, band.value[across] / 1e3, label="found")
axes[1].plot([0, 33, 33, 77, 77, 100], [1, 1, 3, 3, 1, 1], "k--", lw=1, label="truth")
axes[1].set(title="along y = 50 mm", xlabel="x (mm)", ylabel="shear modulus μ (kPa)", ylim=(0, None))
axes[1].legend(frameon=False)
plt.show()

# %% [markdown]
# The regulariser assumes a smooth field, and the true one jumps at the disc's edge. There the intervals hold the truth less often
# than their 95 %.

# %% [markdown]
# ## What time tells
# A plate presses a cube by 5 % in two seconds and stays. From the force alone, with 1 % noise: which share relaxes, and how
# fast? The derivative goes back through all steps, through contact and through what tissue remembers.

# %%
times = np.concatenate([[0.5, 1.0, 1.5, 2.0], np.geomspace(2.5, 24, 12 if FAST else 24)])
relaxes = {"mu": 1000.0, "g": 0.45, "tau": 4.0}


def relaxing(values):
    """A cube under a plate, and its parameters."""
    parameters = {name: ngs.Parameter(value) for name, value in values.items()}
    drive = Drive(ToolMotion("press", (0.0, 2.0, 24.0), (0.0, 1e-3, 1e-3)))
    plate = RigidContact("top", lambda x: 0.02 - drive.parameter - x[2], 1e8, 2e-5)
    law = Prony(NeoHooke(parameters["mu"]), [parameters["g"]], [parameters["tau"]])
    body = Problem(
        block((0.02, 0.02, 0.02), 0.02),
        {"tissue": Material(law, 1e6)},
        {"bottom": 0},
        contacts=[plate],
        element="P2/P1",
    )
    return RunModel(body, drive, [0.0, *times], parameters, [Force("top", (0, 0, 1))])


curve = (run := relaxing(relaxes)).evaluate(run.theta).data
spread = 0.01 * np.abs(curve).max()
curve = curve + spread * rng.normal(size=curve.shape)
run = relaxing({"mu": 2000.0, "g": 0.2, "tau": 10.0})  # started far off
answer = estimate(run, curve, np.full_like(curve, spread))
bars, got = answer.posterior, answer.values
for name, value in relaxes.items():
    bar = bars.interval(name)
    print(f"{name:>4}: {got[name]:.4g}, 95 % between {bar.low[0]:.4g} and {bar.high[0]:.4g}; {value:g} in truth")

figure, axes = plt.subplots(figsize=(5.5, 3.2), layout="constrained")
axes.errorbar(times, -1e3 * curve.ravel(), 1e3 * spread, fmt="k.", label="data, with a noise of 1 %")
axes.plot(times, -1e3 * run.evaluate(run.theta).data.ravel(), label="the model found")
axes.set(xlabel="time (s)", ylabel="force of the plate (mN)", ylim=(0, None))
axes.legend(frameon=False)
plt.show()

# %% [markdown]
# ## Ask for anything
# What is asked of a state is an object with a name, a unit, a value and a gradient: forces, moments, displacements, integrals,
# percentiles of strain. A percentile has no gradient where two points change ranks, so it is the mean of a band of percentiles
# about it; how far that is from the plain one can be read. One of your own is a class of ten lines.


# %%
class Stretch(Observable):
    """By how much two points move apart along x (m)."""

    name, unit = "stretch between two points", "m"

    def on(self, problem):
        """The difference of two displacements."""
        ends = Displacements([[0.02, 0.05], [0.08, 0.05]], (1, 0)).on(problem).matrix
        return LinearObservable(problem, ends[[1]] - ends[[0]])


mu.Set(1000.0)
k.Set(0.8)
strain = StrainPercentile(90, band=0.1)
asked = [Force("top", (0, -1)), strain, Stretch()]
bodies = pressed(coarse, Quartic(mu, k))
body = bodies[0]
LoadPath(body).solve()
for each in asked:
    print(f"{each.name}: {each.value(body)[0]:.4g} {each.unit}")
print(f"the plain percentile is {strain.on(body).raw:.4g}")

# %% [markdown]
# The same objects are data: k from these three numbers of both loads, pressed and sheared, with 1 % of noise, drawn anew each time.

# %%
six = StaticModel([LoadCase(each, asked) for each in bodies], {"k": k})
numbers = six.evaluate(six.theta).data
held, draws = 0, 10 if FAST else 20
for _ in range(draws):
    k.Set(0.4)
    alone = estimate(six, numbers * (1 + 0.01 * rng.normal(size=6)), 0.01 * np.abs(numbers), callback=lambda _: None)
    bar = alone.posterior.interval("k")
    held += bool(bar.low[0] < 0.8 < bar.high[0])
print(f"k = {alone.values['k']:.3f}, 95 % between {bar.low[0]:.3f} and {bar.high[0]:.3f} from the last draw of noise")
print(f"{held} of {draws} intervals hold the truth, .8")

# %% [markdown]
# The same models are functions for PyTorch and JAX, objectives for scipy and UM-Bridge models for sampling programs:
# `ngbrain.interop`.

# %% The numbers.
print(
    f"own law: k {own.values['k']:.2f}, μ within {wrong:.1%}; contrast {contrast:.2f}, g {got['g']:.3f}, tau {got['tau']:.2f} s"
)
assert abs(own.values["k"] - 0.78) < 0.07 and wrong < 0.06, (own.values["k"], wrong)
assert abs(contrast - 2.7) < 0.2, contrast
assert held >= 0.8 * draws, held
assert abs(got["g"] - 0.45) < 0.02 and abs(got["tau"] - 4.0) < 0.3, got
assert np.all(np.abs(rates - 2) < 0.1), rates
