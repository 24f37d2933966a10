# %% [markdown]
# # Contact in any dimension, on any elements
#
# **Question.** What do a plate that slides over relaxing tissue, an indenter of given force on a body with mass, and a rounded
# tool on layered blocks have in common? One `Problem`: tissue, supports, loads, contacts and inertia, each of which goes with
# the others, in plane strain, axisymmetric or in space.
#
# **Numbers to reproduce.** Once all of the top slides, friction over pressure is the coefficient: **0.1** (to 1e-6). The
# indenter of 20 mN ends where a slow one does (within 1 %), although its mass overshot before. The rounded tool is at most 2 %
# of its way deep in the blocks. The last cell of each part checks it.

# %%
import matplotlib.pyplot as plt
import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

import ngbrain
from ngbrain.forward import (
    Axisymmetric,
    ErrorControl,
    Friction,
    Inertia,
    Material,
    PrescribedForce,
    Problem,
    RigidContact,
    StepControl,
    TimeStepper,
)
from ngbrain.materials import NeoHooke, Prony

ngbrain.set_threads(1)
SIDE = 0.02  # m

# %% [markdown]
# ## A sliding plate, plane strain, relaxing tissue
# A rigid body is a signed distance; what moves it is a `Motion`: where it is at a time, at which times its way changes, and how
# far it comes nearer in between, by which steps are chosen.


# %%
class Plate:
    """Down by half a millimetre in a second, then along by three in three."""

    events = (1.0, 4.0)

    def __init__(self):
        self.down, self.along = ngs.Parameter(0.0), ngs.Parameter(0.0)

    def at(self, t):
        return np.interp(t, (0, 1), (0, 5e-4)), np.interp(t, (1, 4), (0, 3e-3))

    def set(self, t):
        down, along = self.at(t)
        self.down.Set(down)
        self.along.Set(along)

    def travel(self, start, end):
        return sum(self.at(end)) - sum(self.at(start))


square = MakeStructured2DMesh(quads=False, nx=6, ny=6, mapping=lambda x, y: (SIDE * x, SIDE * y))
plate, coefficient = Plate(), 0.1
contact = RigidContact(
    "top", lambda x: SIDE - plate.down - x[1], penalty=1e7, softness=1e-5, share=0.9, travel=plate.along
)
rubbing = Friction(contact, coefficient, slip=5e-5, moves=lambda x, way: way * ngs.CF((1.0, 0.0)))
relaxing = {".*": Material(Prony(NeoHooke(1e3), g=[0.5], tau=[2.0]), bulk=1e4)}
block = Problem(square, relaxing, {"bottom": 0}, contacts=[contact, rubbing], element="P2/P1")
across, up = (ngs.GridFunction(block.u.space) for _ in range(2))
across.Set((1, 0))
up.Set((0, 1))
rows = [(0.0, 0.0, 0.0)]


def record(body, progress, newton):
    forces = body.contact_forces()
    rows.append((progress.t, -across.vec.FV().NumPy() @ forces, up.vec.FV().NumPy() @ forces))


TimeStepper(block, plate, StepControl(0.25), penetration_limit=1e-3).run(record)
t, tangential, normal = np.array(rows).T
print(f"friction over pressure at the end: {tangential[-1] / normal[-1]:.7f} (the coefficient is {coefficient})")
assert abs(tangential[-1] / normal[-1] - coefficient) < 1e-6 * coefficient

# %% [markdown]
# ## An indenter of given force, axisymmetric, a body with mass
# `PrescribedForce` prescribes the force over time; the indenter's travel is an additional unknown. `Inertia` is given among
# the loads. Steps are as long as their error allows: milliseconds while the body oscillates, in the end as long as the rest
# of the run.

# %%
half = MakeStructured2DMesh(quads=True, nx=8, ny=8, mapping=lambda x, y: (SIDE * x, SIDE * y))  # the half plane (r, z)
ways = {}
for name, ramp in (("sudden", 0.05), ("slow", 5.0)):
    press = PrescribedForce((0.0, ramp, ramp + 1.0), (0.0, 2e-2, 2e-2), away=-1e-3, nudge=1e-6)
    ball = RigidContact(
        "top", lambda x, p=press: ngs.Norm(x - ngs.CF((0.0, SIDE + 5e-3 - p.parameter))) - 5e-3, 1e9, 1e-6, 0.9, press.parameter
    )  # fmt: skip
    disc = Problem(
        half, {".*": Material(NeoHooke(1e3), bulk=1e4)}, {"bottom": 0, "left": (0, None)}, [Inertia(1000.0)], [ball, press],
        element="P2/P1", kinematics=Axisymmetric(),
    )  # fmt: skip
    way = []
    control = ErrorControl(1e-2, touch=ramp / 50, shortest=1e-7)
    TimeStepper(disc, press, control, 1e-3).run(
        lambda b, at, r, way=way, p=press: way.append((at.t, p.parameter.Get()))
    )
    ways[name] = np.array(way).T
print({name: f"{1e3 * way[-1]:.3f} mm in {len(way)} steps" for name, (_, way) in ways.items()})
assert abs(ways["sudden"][1][-1] / ways["slow"][1][-1] - 1) < 0.01

# %% [markdown]
# ## A rounded tool on two blocks, hexahedra
# The lower block is three times as stiff. The contact's offset makes up for what its penalty gives way.

# %%
cube = MakeStructured3DMesh(hexes=True, nx=3, ny=3, nz=4, mapping=lambda x, y, z: (SIDE * x, SIDE * y, SIDE * z))
stiff = ngs.IfPos(ngs.z - SIDE / 2, 1e3, 3e3)


class Ball(Plate):
    """Down by 1.5 mm in a second."""

    events = (1.0,)

    def at(self, t):
        return 1.5e-3 * t, 0.0


tool, radius = Ball(), 0.03
met = RigidContact(
    "top", lambda x: ngs.Norm(x - ngs.CF((SIDE / 2, SIDE / 2, SIDE + radius - tool.down))) - radius, 1e8, 2e-6, 0.995
)
blocks = Problem(cube, {".*": Material(NeoHooke(stiff), bulk=1e5)}, {"bottom": 0}, contacts=[met], element="P2/P1")
TimeStepper(blocks, tool, StepControl(0.5), penetration_limit=1e-3).run(lambda *_: None)
print(f"force {-blocks.force('bottom')[2]:.4f} N on the tool, at most {-1e6 * blocks.min_gap():.1f} µm deep")
assert -blocks.min_gap() < 0.02 * 1.5e-3

# %%
figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
axes[0].plot(t, tangential, label="friction")
axes[0].plot(t, coefficient * normal, "--", label=f"{coefficient:g} × pressure")
axes[0].set(xlabel="time (s)", ylabel="force (N/m)", title="A plate presses, then slides")
axes[0].legend()
for name, (times, way) in ways.items():
    axes[1].semilogx(times, 1e3 * way, ".-", label=f"{name} force")
axes[1].set(xlabel="time (s)", ylabel="indentation (mm)", title="An indenter of 20 mN")
axes[1].legend()
plt.show()
