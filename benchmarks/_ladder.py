"""Scenes to climb in: what is given and asked, and how rich a model of them may be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ngbrain.scene import DisplacementBC, Geometry, Gravity, MeshSize, Quantity, Scene, Time, Tissue, Traction

SKULL = (DisplacementBC(boundary="skull"),)
FOOT = DisplacementBC(boundary="bottom")
CORTEX, WHITE = "griffiths2024:cortex", "griffiths2024:white_matter"
RICH, RICHER = {"order": "2", "mesh": "1"}, {"order": "2", "mesh": "2"}
"""With pressures, displacements of third order; elements a half or, in bars, a quarter of the coarsest."""
CELL = 0.0165
DRAWN = (0, 1, 2, 6)
"""Seeds of scenes; the richest model of 3 takes more than 25 minutes."""


@dataclass(frozen=True)
class Case:
    """A scene and the bounds of its axes."""

    scene: Scene
    richest: dict[str, str]


def cases() -> dict[str, Case]:
    """All of them, by name."""
    return {**named(), **{f"drawn {seed}": drawn(seed) for seed in DRAWN}}


def named() -> dict[str, Case]:
    """From trivial to hard."""
    plate = Geometry(kind="block", size=(0.06, 0.06, 0.04), plate=(0.02, 0.02))
    slot = Geometry(kind="block", size=(0.06, 0.06, 0.04), slot=(0.004, 0.02))
    cortex, white = Tissue(material=CORTEX), Tissue(material=WHITE)
    on_plate = Quantity(name="force", boundary="plate")

    def pressed(mm: float, ramp: float, elapsed: float, hold: str = "bonded") -> Scene:
        given = (FOOT, DisplacementBC(boundary="plate", value=(0, 0, -mm / 1000), contact=hold))
        return Scene(
            mesh=MeshSize(largest=CELL),
            geometry=plate,
            tissues=(cortex,),
            displacement_bcs=given,
            time=Time(ramp=ramp, end=elapsed),
            quantities=(on_plate,),
        )

    def spread(mm: float, ramp: float, elapsed: float, geometry: Geometry = slot) -> Scene:
        given = (FOOT, DisplacementBC(boundary="wall_plus", value=(mm / 1000, 0, 0)))
        asks = (
            Quantity(name="force", boundary="wall_plus", direction=(1, 0, 0)),
            Quantity(name="strain", point=(0, 0, 0.03), radius=0.02, percentile=90),
        )
        return Scene(
            mesh=MeshSize(largest=CELL),
            geometry=geometry,
            tissues=(white,),
            displacement_bcs=given,
            time=Time(ramp=ramp, end=elapsed),
            quantities=asks,
        )

    ball = Geometry(kind="block", size=(0.06, 0.06, 0.04), lesion_centre=(0.0, 0.0, 0.02), lesion_radius=0.008)
    soft = Tissue(poissons_ratio=0.49, region="tissue", mu=(1000.0,))
    stiff = Tissue(poissons_ratio=0.49, region="lesion", mu=(5000.0,))
    pressed_top = (FOOT, DisplacementBC(boundary="top", value=(0, 0, -0.002)))
    bar = Geometry(kind="block", size=(0.02, 0.02, 0.06))
    shaken = Geometry(kind="block", size=(0.06, 0.03, 0.06), lesion_radius=0.008, lesion_centre=(0, 0, 0.03))
    lossy = (
        Tissue(poissons_ratio=0.49, region="tissue", mu=(3000.0,), loss_tangent=0.3),
        Tissue(poissons_ratio=0.49, region="lesion", mu=(9000.0,), loss_tangent=0.3),
    )
    centre = Quantity(name="displacement", point=(0, 0, 0.03), direction=(1, 0, 0))

    def stretched(mm: float, stuff: Tissue) -> Scene:
        given = (FOOT, DisplacementBC(boundary="top", value=(0, 0, mm / 1000)))
        return Scene(
            mesh=MeshSize(largest=CELL),
            geometry=bar,
            tissues=(stuff,),
            displacement_bcs=given,
            quantities=(Quantity(name="force", boundary="top"),),
        )

    budday = Tissue(poissons_ratio=0.49, mu=(1442.0,), alpha=(-19.0,))
    fibred = Tissue(poissons_ratio=0.49, mu=(1000.0,), fibre_stiffness=4000.0, fibre_exponent=2.0, fibre=(0, 0, 1))
    slanted = Tissue(poissons_ratio=0.49, mu=(1000.0,), fibre_stiffness=4000.0, fibre_exponent=2.0, fibre=(1, 0, 1))
    sheared = Scene(
        mesh=MeshSize(largest=CELL),
        geometry=bar,
        tissues=(slanted,),
        displacement_bcs=(FOOT, DisplacementBC(boundary="top", value=(0.006, 0, 0))),
        quantities=(Quantity(name="force", boundary="top", direction=(1, 0, 0)),),
    )
    wide = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=Geometry(kind="block", size=(0.12, 0.12, 0.04), plate=(0.02, 0.02)),
        tissues=(soft,),
        displacement_bcs=(FOOT, DisplacementBC(boundary="plate", value=(0, 0, -0.001))),
        quantities=(on_plate,),
    )
    slid = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=Geometry(kind="block", size=(0.06, 0.06, 0.04), plate=(0.03, 0.024)),
        tissues=(Tissue(poissons_ratio=0.49, mu=(350.0,), alpha=(-10.0,)),),
        displacement_bcs=(FOOT, DisplacementBC(boundary="plate", value=(0, 0, -0.003), contact="frictionless")),
        quantities=(on_plate,),
    )
    dull = tuple(
        Tissue(poissons_ratio=0.49, region=region, mu=(mu,), loss_tangent=0.5)
        for region, mu in ((".*", 3000.0), ("lesion", 9000.0))
    )
    aslant = Scene(
        mesh=MeshSize(largest=CELL),
        geometry=Geometry(kind="block", size=(0.05, 0.03, 0.05), lesion_radius=0.008, lesion_centre=(0, 0, 0.025)),
        tissues=dull,
        displacement_bcs=(DisplacementBC(boundary="left", value=(0, 0, 1e-4)),),
        time=Time(frequency=20),
        quantities=(Quantity(name="displacement", point=(0.01, 0, 0.025), direction=(0, 0, 1)),),
    )
    head = Geometry(kind="idealised")
    regions = (
        Tissue(poissons_ratio=0.49, mu=(600.0,)),
        Tissue(poissons_ratio=0.49, region="cortex", mu=(1400.0,)),
        Tissue(region="ventricle.*", mu=(10.0,), poissons_ratio=0.1),
    )
    tilted = Scene(
        mesh=MeshSize(largest=0.03),
        gravity=Gravity(acceleration=(0.0, 6.867, -6.867)),
        geometry=head,
        tissues=regions,
        displacement_bcs=SKULL,
        time=Time(),
        quantities=(Quantity(name="displacement", point=(0.03, 0, 0.02), direction=(0, 1, -1)),),
    )
    hanging = Scene(
        mesh=MeshSize(largest=CELL),
        gravity=Gravity(acceleration=(9.81, 0.0, 0.0)),
        geometry=Geometry(kind="block", size=(0.04, 0.04, 0.06)),
        tissues=(Tissue(poissons_ratio=0.49, mu=(2000.0,)),),
        displacement_bcs=(FOOT,),
        time=Time(),
        quantities=(Quantity(name="displacement", point=(0, 0, 0.06), direction=(1, 0, 0)),),
    )
    pulled = Scene(
        mesh=MeshSize(largest=CELL),
        geometry=plate,
        tissues=(cortex,),
        displacement_bcs=(FOOT,),
        tractions=(Traction(boundary="plate", value=(0, 0, -400.0)),),
        time=Time(ramp=1, end=600),
        quantities=(Quantity(name="displacement", point=(0, 0, 0.04), direction=(0, 0, -1)),),
    )
    aside = (FOOT, DisplacementBC(boundary="top", value=(0.001, 0, 0)))
    struck = Scene(
        mesh=MeshSize(largest=CELL),
        geometry=bar,
        tissues=(soft,),
        displacement_bcs=aside,
        time=Time(ramp=0.03, end=0.03),
        quantities=(Quantity(name="force", boundary="top", direction=(1, 0, 0)),),
    )
    return {
        "bar struck aside, 30 ms": Case(struck, RICHER),
        "plate struck, 1 mm in 30 ms": Case(pressed(1, 0.03, 0.03), RICH),
        "bar pulled 0.1 mm": Case(stretched(0.1, soft), RICHER),
        "bar pressed 20 %, alpha -19": Case(stretched(-12, budday), RICHER),
        "bar pulled 20 %, alpha -19": Case(stretched(12, budday), RICHER),
        "fibres pulled 10 %": Case(stretched(6, fibred), RICHER),
        "fibres sheared 10 %": Case(sheared, RICHER),
        "palpation 0.2 mm, 1 s": Case(pressed(0.2, 1, 1), RICH),
        "plate 1 mm, wide block": Case(wide, RICH),
        "plate 2 mm, 1 s": Case(pressed(2, 1, 1), RICH),
        "plate 2 mm, 1 s, sliding": Case(pressed(2, 1, 1, "frictionless"), RICH),
        "plate 3 mm, sliding, alpha -10": Case(slid, RICH),
        "plate 6 mm, an hour": Case(pressed(6, 10, 3600), RICH),
        "plate of 400 Pa, 10 min": Case(pulled, RICH),
        "retraction 2 mm, 10 s": Case(spread(2, 10, 10), RICH),
        "retraction 10 mm, 10 s": Case(spread(10, 10, 10), RICH),
        "retraction 5 mm, an hour": Case(spread(5, 10, 3600), RICH),
        "thin cleft, 0.5 mm": Case(
            spread(0.5, 1, 1, Geometry(kind="block", size=(0.06, 0.06, 0.04), slot=(0.001, 0.02))), RICH
        ),
        "stiff lesion": Case(
            Scene(
                mesh=MeshSize(largest=0.018),
                geometry=ball,
                tissues=(soft, stiff),
                displacement_bcs=pressed_top,
                quantities=(
                    Quantity(name="force", boundary="top"),
                    Quantity(name="strain", region="lesion", percentile=50),
                ),
            ),
            RICH,
        ),
        "wave of 50 Hz": Case(
            Scene(
                mesh=MeshSize(largest=CELL),
                geometry=shaken,
                tissues=lossy,
                displacement_bcs=(DisplacementBC(boundary="bottom", value=(1e-4, 0, 0)),),
                time=Time(frequency=50),
                quantities=(centre,),
            ),
            RICH,
        ),
        "wave of 20 Hz": Case(aslant, RICH),
        "wave of 5 Hz": Case(
            Scene(
                mesh=MeshSize(largest=CELL),
                geometry=shaken,
                tissues=lossy,
                displacement_bcs=(DisplacementBC(boundary="bottom|top", value=(1e-4, 0, 0)),),
                time=Time(frequency=5),
                quantities=(centre,),
            ),
            RICH,
        ),
        "gravity, head": Case(tilted, RICH),
        "gravity, block on its side": Case(hanging, RICHER),
    }


def drawn(seed: int) -> Case:
    """Site, blade, rate and tissue at random."""
    random = np.random.default_rng(seed)
    tissue = Tissue(material=str(random.choice([CORTEX, WHITE, "griffiths2024:deep_grey"])))
    ramp, far = float(10 ** random.uniform(-1, 1.5)), float(random.uniform(0.5, 6) / 1000)
    elapsed = ramp + float(10 ** random.uniform(-1, 3.5))
    course, tissues = Time(ramp=ramp, end=elapsed), [tissue]
    if random.random() < 0.5:
        width = float(random.uniform(0.012, 0.028))
        lesion = float(random.uniform(0.004, 0.008)) if random.random() < 0.5 else None
        piece = Geometry(
            kind="block",
            size=(0.06, 0.06, 0.04),
            plate=(width, width),
            lesion_radius=lesion,
            lesion_centre=(0, 0, 0.017) if lesion else None,
        )
        if lesion:
            modulus = float(tissue.initial_modulus * random.choice([0.3, 4.0]))
            tissues[0] = replace(tissues[0], region="tissue")
            tissues.append(Tissue(poissons_ratio=0.49, region="lesion", mu=(modulus,)))
        given, quantity = (
            (FOOT, DisplacementBC(boundary="plate", value=(0, 0, -far))),
            Quantity(name="force", boundary="plate"),
        )
    else:
        depth = float(random.uniform(0.012, 0.028))
        piece = Geometry(kind="block", size=(0.06, 0.06, 0.04), slot=(float(random.uniform(0.002, 0.006)), depth))
        given = (FOOT, DisplacementBC(boundary="wall_plus", value=(far, 0, 0)))
        quantity = Quantity(name="force", boundary="wall_plus", direction=(1, 0, 0))
    return Case(
        Scene(
            mesh=MeshSize(largest=CELL),
            geometry=piece,
            tissues=tuple(tissues),
            displacement_bcs=given,
            time=course,
            quantities=(quantity,),
        ),
        RICH,
    )
