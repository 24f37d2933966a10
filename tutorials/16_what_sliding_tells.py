# %% [markdown]
# # What sliding tells: friction and relaxation from the force of a plate
#
# **Question.** A plate presses on tissue that relaxes, slides along it and stops. What do its forces tell of the tissue and of the
# friction, and what does the normal force tell alone?
#
# **Numbers to reproduce.** From both components of the force, with 1 % noise: friction within **5 %** of .1 and the relaxation
# time within **15 %** of 3 s, inside their 95 % intervals. From the normal force alone: friction **not determined**. The last cell
# checks them. The data come from other elements, cubic on a finer mesh, and steps four times as fine.

# %%
import os
from itertools import pairwise

import matplotlib.pyplot as plt
import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh

import ngbrain
from ngbrain.adjoint import taylor
from ngbrain.forward import Force, Friction, Material, Problem, RigidContact, RunModel
from ngbrain.inverse import estimate
from ngbrain.materials import NeoHooke, Prony

ngbrain.set_threads(1)
FAST = bool(os.environ.get("NGBRAIN_FAST"))
WIDTH, HEIGHT = 0.04, 0.02  # m

# %% [markdown]
# ## The run
# The plate goes down by .8 mm in a second, along by 2 mm in two more, and stays for ten. Friction is Coulomb's: the wall sticks up
# to the traction μP and slides with that, so forces remember where it slipped.


# %%
class Plate:
    """Where the plate is over time."""

    events = (1.0, 3.0, 13.0)

    def __init__(self):
        self.down, self.along = ngs.Parameter(0.0), ngs.Parameter(0.0)

    def at(self, t):
        return np.interp(t, (0, 1), (0, 8e-4)), np.interp(t, (1, 3), (0, 2e-3))

    def set(self, t):
        down, along = self.at(t)
        self.down.Set(down)
        self.along.Set(along)

    def travel(self, start, end):
        return self.at(end)[0] - self.at(start)[0]


TIMES = [0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 8, 10, 13]
STEPS = [*np.arange(0, 3.75, 0.25), 4, 4.5, 5, 6, 7, 8, 10, 13]


def run(values, cells, element, steps, seen):
    """A block in plane strain between its base and the plate, as a function of its parameters."""
    mesh = MakeStructured2DMesh(quads=False, nx=2 * cells, ny=cells, mapping=lambda x, y: (WIDTH * x, HEIGHT * y))
    numbers, plate = {name: ngs.Parameter(value) for name, value in values.items()}, Plate()
    contact = RigidContact("top", lambda x: HEIGHT - plate.down - x[1], 2e7, 1e-5, share=0.9, travel=plate.along)
    rubbing = Friction(contact, numbers["friction"], slip=5e-5, moves=lambda x, way: way * ngs.CF((1.0, 0.0)))
    tissue = Material(Prony(NeoHooke(numbers["mu"]), g=[numbers["g"]], tau=[numbers["tau"]]), bulk=5e4)
    block = Problem(mesh, {".*": tissue}, {"bottom": 0}, contacts=[contact, rubbing], element=element)
    return RunModel(block, plate, steps, numbers, seen, TIMES)


truth = {"mu": 1000.0, "g": 0.5, "tau": 3.0, "friction": 0.1}
finer = np.unique(np.concatenate([np.linspace(a, b, 5) for a, b in pairwise(STEPS)]))
real = run(truth, 6, "P3/P2", finer, [Force("top")])
exact = real.evaluate(real.theta).data
noise = 0.01 * np.sqrt(np.mean(exact**2, axis=0)) * np.ones_like(exact)

# %% [markdown]
# ## Is the derivative right?
# It is carried through time, through sticking and sliding: pressure and normal change the traction, and the slip at the end of a
# step is where the next begins. Rates of 2 say that it is right; a step that lets a point begin to slide has a kink.

# %%
guess = {"mu": 2000.0, "g": 0.3, "tau": 8.0, "friction": 0.3}
model = run(guess, 3, "P2/P1", STEPS, [Force("top")])
theta, w = model.theta, 1 / noise
gradient = model.evaluate(theta).gradient(w)
for name, place in model.blocks.items():
    direction = np.zeros(model.size)
    direction[place] = theta[place]
    rates = taylor(lambda x: float(np.sum(w * model.evaluate(x).data)), gradient, theta, direction, first=2e-3, steps=2)
    print(f"{name:>8}: rates {rates.round(2)}")

# %% [markdown]
# ## Both components of the force

# %%
cells = 3 if FAST else 5
rng = np.random.default_rng(0)
measured = exact + noise * rng.normal(size=exact.shape)
both = estimate(run(guess, cells, "P2/P1", STEPS, [Force("top")]), measured, noise, callback=lambda _: None)
print(both)

# %% [markdown]
# ## The normal force alone
# It falls while the plate slides, by how much depends a little on the friction: the interval is wide, and the answer says so.

# %%
normal = run(guess, cells, "P2/P1", STEPS, [Force("top", (0, 1))])
alone = estimate(normal, measured[:, 1:], noise[:, 1:], callback=lambda _: None)
print(alone)

# %%
figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
found = both.problem.evaluate(both.x).state.data
for axis, i, name in ((axes[0], 1, "normal"), (axes[1], 0, "tangential")):
    axis.errorbar(TIMES, np.abs(measured[:, i]), noise[:, i], fmt="k.", label="data, with a noise of 1 %")
    axis.plot(TIMES, np.abs(found[:, i]), label="the model found")
    axis.set(xlabel="time (s)", ylabel=f"{name} force (N/m)", ylim=(0, None))
    axis.axvspan(1, 3, color="0.92", label="sliding")
axes[0].legend(frameon=False)
plt.show()

# %% The numbers.
values, bars = both.values, both.posterior
assert abs(values["friction"] / 0.1 - 1) < 0.05 and abs(values["tau"] / 3.0 - 1) < 0.15, values
for name in ("friction", "tau"):
    band = bars.interval(name)
    assert band.low[0] < truth[name] < band.high[0], name
assert not both.undetermined and "friction" in alone.undetermined, (both.undetermined, alone.undetermined)
