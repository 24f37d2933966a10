# %% [markdown]
# # Materials: a law, its constants, its test
#
# **Question.** Human cortex has been pressed, pulled and sheared. Which law describes all three, what does it cost, and
# what does tissue do that no elastic law can?
#
# **Number to reproduce.** One-term Ogden on Budday's averaged curves of the cortex: μ = **1.44 kPa**, α = **-19.2**, both
# within 3 %; with cubes that stick to their plates **1.43 kPa** and **-14.4** (the last cell checks both).

# %%
import matplotlib.pyplot as plt
import ngsolve as ngs
import numpy as np

import ngbrain
from ngbrain.forward import Material, Problem
from ngbrain.inverse import BondedSpecimen
from ngbrain.materials import (
    CATALOGUE,
    Deformation,
    Demiray,
    HolzapfelGasserOgden,
    Maxwell,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    Prony,
    Viscous,
    constants,
    density,
    fourier,
    lab,
)
from ngbrain.mesh import block

ngbrain.set_threads(1)

# %% [markdown]
# ## Constants
# By name, with where they come from and how far they reach. Leaving that range warns once.

# %%
print(len(CATALOGUE), "entries:", *[name for name in CATALOGUE if name.count(":") == 1])
entry = constants("budday2017:cortex")
print(f"{entry.source}, {entry.doi}: {entry.species} {entry.region}; {entry.protocol}; stretch {entry.stretch}")
print(entry.law())

# %% [markdown]
# ## The laboratory
# Four tests without a mesh: uniaxial, equibiaxial, planar, shear. The nominal stress comes from the energy, the
# pressure from the free surface. `fit` takes a law (or a function that makes one) and curves.

# %%
data = lab.budday("cortex")
fits = {
    "Neo-Hooke": lab.fit(NeoHooke, data, {"mu": 500.0}),
    "Mooney-Rivlin": lab.fit(MooneyRivlin, data, {"c10": 100.0, "c01": 200.0}),
    "Demiray": lab.fit(Demiray, data, {"mu": 500.0, "b": 10.0}, {"b": (0.1, 100.0)}),
    "Ogden": lab.fit(Ogden, data, {"mu": 500.0, "alpha": -15.0}),
}
for name, found in fits.items():
    numbers = ", ".join(f"{key} {value:.4g}" for key, value in found.parameters.items())
    print(f"{name:<14} R² " + "  ".join(f"{mode} {r2:.3f}" for mode, r2 in found.r2.items()) + f"   {numbers}")
best = fits["Ogden"]
print("95 % intervals:", {key: tuple(round(end, 1) for end in ends) for key, ends in best.confidence.items()})
lab.plot({name: found.law for name, found in fits.items()}, data)

# %% [markdown]
# Neo-Hooke cannot be stiffer in compression than in tension; Mooney-Rivlin can, for a tenth more of an assembly's time;
# Ogden follows all three curves for 2.3 times (`benchmarks/materials_cost.py`).

# %% [markdown]
# ### Cubes are glued
# All this takes the cubes for homogeneous. They were glued: pressed, they cannot widen at the plates and resist more, sheared,
# their free sides do not take part and they resist less. `BondedSpecimen` computes the cubes' whole fields (here on a coarse mesh,
# 2 % off in μ), with exact derivatives by the constants.

# %%
cube = BondedSpecimen(size=(0.005, 0.005, 0.005), maxh=0.0025)
for mode, stretch in (("uniaxial", 0.9), ("uniaxial", 1.1), ("shear", 0.2)):
    glued, free = (float(test(best.law, mode, [stretch])[0]) for test in (cube.stress, lab.stress))
    print(f"{mode:<9} {stretch}: {glued:8.1f} Pa glued, {free:8.1f} Pa homogeneous, {glued / free:.2f} times")
whole = cube.fit(Ogden, data, best.parameters)
print(
    {key: round(value, 1) for key, value in whole.parameters.items()},
    {key: round(r2, 2) for key, r2 in whole.r2.items()},
)

# %% [markdown]
# The same law now follows the curves worse: what one exponent explains in homogeneous cubes, it does not in glued ones. Of
# cubes made of a known law, homogeneous fits find α = -7 in place of -19 (`benchmarks/bonded_fits.py`).

# %% [markdown]
# ## A law of your own
# Any object with `energy(C)`: of the isochoric C̄, so that no volume change has to be thought of. It works wherever the
# package takes a law. Here, in the laboratory, fitted, relaxing and in a body.


# %%
class Softening:
    """W = μ/2 (I₁ - 3) + c (I₂ - 3)²."""

    def __init__(self, mu, c):
        self.mu, self.c = mu, c

    def energy(self, C):
        i2 = (ngs.Trace(C) ** 2 - ngs.InnerProduct(C, C)) / 2
        return self.mu / 2 * (ngs.Trace(C) - 3) + self.c * (i2 - 3) * (i2 - 3)


mine = lab.fit(Softening, data, {"mu": 1000.0, "c": 1000.0})
print(
    "mine:", {key: round(value) for key, value in mine.parameters.items()}, {k: round(r, 3) for k, r in mine.r2.items()}
)
relaxing = Prony(mine.law, g=[0.45, 0.365], tau=[0.5, 50.0])
body = Problem(block((0.02,) * 3, 0.01), {"tissue": Material(relaxing, bulk=1e6)}, {"bottom": 0}, element="P2/P1")
body.u.Set(ngs.CF((0, 0, -0.1 * ngs.z)))
body.begin(1.0)
print(f"largest nodal force, pressed by a tenth: {1e3 * np.abs(body.tissue_forces()).max():.1f} mN")

# %% [markdown]
# A parameter may be a field to invert for, and energies are derived by it: the power that a change of μ makes in a body.

# %%
mu = ngs.GridFunction(ngs.L2(body.mesh, order=0))
mu.Set(1000 + 4e4 * ngs.x)
W = density(Softening(mu, 1000.0), Deformation.from_gradient(ngs.Id(3) + ngs.Grad(body.u)))
print(f"dW/dμ · 1 = {ngs.Integrate(W.Diff(mu), body.mesh):.3e} m³, W = {ngs.Integrate(W, body.mesh):.3e} J")

# %% [markdown]
# ## Fibres
# White matter is stiffer along its axons. Families are fields; pressed fibres bear nothing. Parts add up.

# %%
white = constants("budday2017:corona_radiata").law() + HolzapfelGasserOgden(50.0, 400.0, 3.0, 0.1, (1, 0, 0))
print("pulled along and pressed along:", lab.stress(white, "uniaxial", [1.08, 0.92]).round(1), "Pa")

# %% [markdown]
# ## Time
# A quasi-linear law relaxes alike at every strain. Branches of finite viscoelasticity have a spring that stiffens, which
# pushes its dashpot harder: tissue strained further relaxes faster. Griffiths' constants are of this kind.

# %%
tissue = constants("griffiths2024:white_matter").law()
hereditary = Prony(Ogden(1380.0, -25.0), g=[970 / 1380, 250 / 1380], tau=[2.26, 1199.0])
times = np.concatenate([[0.0], np.geomspace(0.01, 1.0, 60)])
figure, axes = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained", sharey=True)
for ax, (name, material) in zip(axes, {"quasi-linear": hereditary, "finite": tissue}.items(), strict=True):
    left = {strain: lab.relaxation(material, "uniaxial", 1 - strain, times) for strain in (0.01, 0.05, 0.1)}
    print(f"{name:<13} left after 1 s at 1, 5, 10 %:", np.round([s[-1] / s[0] for s in left.values()], 3))
    for (strain, s), dash in zip(left.items(), ("-", "--", ":"), strict=True):
        ax.plot(times, s / s[0], dash, label=f"pressed by {100 * strain:.0f} %")
    ax.set(title=name, xlabel="time (s)")
axes[0].set_ylabel("stress / stress at once")
axes[1].legend(frameon=False)
plt.show()

# %% [markdown]
# ## Frequency
# The same branches at small strain, as elastography sees them.

# %%
G = fourier(Viscous(NeoHooke(1000.0), (Maxwell(NeoHooke(2000.0), 4.0),)))(2 * np.pi * 50)
print(f"at 50 Hz: storage {G.real / 1e3:.2f}, loss {G.imag / 1e3:.2f} kPa")

# %% The number.
mu_fit, alpha = best.parameters["mu"], best.parameters["alpha"]
print(f"μ = {mu_fit / 1e3:.2f} kPa, α = {alpha:.1f}")
assert abs(mu_fit / 1442 - 1) < 0.03 and abs(alpha / -19.2 - 1) < 0.03, (mu_fit, alpha)
assert abs(whole.parameters["mu"] / 1433 - 1) < 0.02 and abs(whole.parameters["alpha"] / -14.4 - 1) < 0.02, (
    whole.parameters
)
