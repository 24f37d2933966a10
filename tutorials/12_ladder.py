# %% [markdown]
# # No more model than needed: the ladder
#
# **Question.** A plate of 20 by 20 mm presses on cortex. How hard, and what has to be modelled to know it within 10 or 15 %?
#
# **Numbers to reproduce.** A gentle touch (0.2 mm in a second) needs no finite strain, a press of 6 mm held for an hour does. The
# touch takes **0.050 N** (± 10 %), the press has **1.4 to 2.3 N** left after an hour; a blow of 1 mm in 30 ms on a column meets its
# impedance, **13.6 mN** (± 15 %). The last cells check this.

# %%
import os

import matplotlib.pyplot as plt

import ngbrain
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Time, Tissue

ngbrain.set_threads(1)
FAST = bool(os.environ.get("NGBRAIN_FAST"))

# %% [markdown]
# ## A scene says what is asked, and how accurately
# What is loaded, what it is made of, how it is held; then the questions, each with the relative error that its answer may have.
# Nothing is said about elements, orders, time steps or theories.


# %%
def pressed(mm: float, ramp: float, elapsed: float, tolerance: float) -> Scene:
    """Cortex under a plate."""
    return Scene(
        mesh=MeshSize(largest=0.02),
        geometry=Geometry(kind="block", size=(0.06, 0.06, 0.04), plate=(0.02, 0.02)),
        tissues=(Tissue(material="griffiths2024:cortex"),),
        displacement_bcs=(
            DisplacementBC(boundary="bottom"),
            DisplacementBC(boundary="plate", value=(0, 0, -mm / 1000)),
        ),
        time=Time(ramp=ramp, end=elapsed),
        quantities=(Quantity(name="force", boundary="plate", tolerance=tolerance),),
    )


# %% [markdown]
# ## The climb
# The first model is the cheapest there is: a plane section, small strains, the stiffness of the first instant, elements of first
# order. For every axis along which it could be richer, the residual of the richer model at the cheap solution, weighted with
# adjoint solutions, says by how much the answers would move. The step that gains most for its cost is taken, finer elements after
# all physics that cannot be left out, until what is left is within the tolerance. Elements get smaller at first only where the
# question needs it: at the plate's edge, not in the corners of the block.


# %%
def show(result: dict) -> None:
    """Each rung, and what the last one leaves out."""
    for rung in result["rungs"]:
        step = rung["taken"] or "chosen"
        print(
            f"{rung['cost_s']:6.1f} s {rung['ndof']:7} unknowns, {100 * max(rung['missing']):8.3g} % missing -> {step}"
        )
    for each in result["left_out"]:
        print(f"  without {each['what']}: {100 * abs(each['change'][0]):.2g} % ({each['how']})")


bounds = {"order": "1", "mesh": "1"} if FAST else {"order": "2", "mesh": "1"}
touch = ngbrain.simulate(pressed(0.2, 1.0, 1.0, 0.1), richest=bounds)
show(touch)

# %% [markdown]
# Strains of a few per cent: they stay linear. Relaxation within the second counts, and is told by the history of the load alone;
# nobody has to step through time for it.

# %%
press = ngbrain.simulate(pressed(6.0, 10.0, 3600.0, 0.15), richest=bounds)
show(press)

# %% [markdown]
# ## As fast as a wave
# A column of 1 kPa, 60 mm high, whose sides slip aside but not up: a shear wave takes 61 ms through it. Its top goes aside by 1 mm
# in 30 ms. At rest that would take μAd/L, 6.7 mN; but the foot has not heard of it yet, and the top meets the column's impedance,
# A √(ρμ) d/t = 13.6 mN. Nobody has to know beforehand: inertia is an axis where loads grow in less than three such times.

# %%
TOP = DisplacementBC(boundary="top", value=(1e-3, 0, 0))
struck = Scene(
    mesh=MeshSize(largest=0.0165),
    geometry=Geometry(kind="block", size=(0.02, 0.02, 0.06)),
    tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
    displacement_bcs=(
        DisplacementBC(boundary="bottom"),
        DisplacementBC(boundary="left|right|front|back", components="yz"),
        TOP,
    ),
    time=Time(ramp=0.03, end=0.03),
    quantities=(Quantity(name="force", boundary="top", direction=(1, 0, 0), tolerance=0.1),),
)
blow = ngbrain.simulate(struck, richest=bounds)
show(blow)
impedance = 0.02**2 * (1040 * 1e3) ** 0.5 * 1e-3 / 0.03

# %% [markdown]
# ## Three climbs in one picture
# Each point is a model that was solved; a climb ends where its estimate is below the tolerance that was asked for (dashed).

# %%
figure, axes = plt.subplots(figsize=(6.5, 3.6), layout="constrained")
for name, result, tolerance, colour in (
    ("touch", touch, 10, "C0"),
    ("press, held for an hour", press, 15, "C1"),
    ("blow", blow, 10, "C2"),
):
    missing = [100 * max(rung["missing"]) for rung in result["rungs"]]
    axes.loglog([rung["ndof"] for rung in result["rungs"]], missing, "o-", color=colour, label=name)
    axes.axhline(tolerance, color=colour, ls="--", lw=0.8)
axes.set(xlabel="unknowns of the model", ylabel="estimated error of the answer (%)")
axes.legend(frameon=False)
plt.show()

# %% [markdown]
# In the same way `contact="frictionless"` says that a boundary is pushed by a rigid face along which tissue may slide, and from
# which it may part; whether that counts is for the ladder to find out.

# %% [markdown]
# ## By hand
# Any rung can be fixed. The answer then says what that model leaves out, and how much that matters.

# %%
fixed = ngbrain.simulate(
    pressed(6.0, 10.0, 3600.0, 0.15), model={"space": "plane", "pressure": "unknown", "time": "relaxed"}
)
show(fixed)

# %% [markdown]
# From the command line the same is `ngbrain simulate SCENE.toml`, with a page that draws the way.

# %%
print(pressed(0.2, 1.0, 1.0, 0.1).to_toml())

# %%
(pull,) = blow.value.values()
print(f"a blow takes {1e3 * pull:.1f} mN, {pull / impedance:.2f} of the impedance times the speed")
assert blow["model"]["inertia"] == "all" and abs(pull / impedance - 1) < 0.15

# %%
force = [-result.value["force on plate, end"] for result in (touch, press)]
print(f"touch {force[0]:.4f} N, press {force[1]:.2f} N")
assert touch["model"]["strain"] == "linear" and press["model"]["strain"] == "finite"
assert abs(force[0] - 0.050) < 0.005 and 1.4 < force[1] < 2.3
assert max(touch.errors.values()) <= 0.1 or touch["flags"]
