"""Scenes to climb in: what is given and asked, and how rich a model of them may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.scene.loading import Ask, Course, Given, Loading, Piece, Pull, Stuff

SKULL = (Given(boundary="skull"),)
FOOT = Given(boundary="bottom")
CORTEX, WHITE = "griffiths2024:cortex", "griffiths2024:white_matter"
RICH, RICHER = {"order": "2", "mesh": "1"}, {"order": "2", "mesh": "2"}
"""With pressures, displacements of third order; elements a half or, in bars, a quarter of the coarsest."""
CELL = 0.0165
DRAWN = (0, 1, 2, 6)
"""Seeds of scenes; the richest model of 3 takes more than 25 minutes."""


@dataclass(frozen=True)
class Case:
    """A scene and the bounds of its axes."""

    scene: Loading
    richest: dict[str, str]


def cases() -> dict[str, Case]:
    """All of them, by name."""
    return {**named(), **{f"drawn {seed}": drawn(seed) for seed in DRAWN}}


def named() -> dict[str, Case]:
    """From trivial to hard."""
    plate = Piece(plate=(0.02, 0.02), cell=CELL)
    slot = Piece(slot=(0.004, 0.02), cell=CELL)
    cortex, white = Stuff(constants=CORTEX), Stuff(constants=WHITE)
    on_plate = Ask(boundary="plate")

    def pressed(mm: float, ramp: float, elapsed: float, hold: str = "tied") -> Loading:
        given = (FOOT, Given(boundary="plate", by=(0, 0, -mm / 1000), hold=hold))
        return Loading(
            piece=plate, stuff=(cortex,), given=given, course=Course(ramp=ramp, elapsed=elapsed), ask=(on_plate,)
        )

    def spread(mm: float, ramp: float, elapsed: float, piece: Piece = slot) -> Loading:
        given = (FOOT, Given(boundary="wall_plus", by=(mm / 1000, 0, 0)))
        asks = (
            Ask(boundary="wall_plus", direction=(1, 0, 0)),
            Ask(quantity="strain", point=(0, 0, 0.03), within=0.02, percentile=90),
        )
        return Loading(piece=piece, stuff=(white,), given=given, course=Course(ramp=ramp, elapsed=elapsed), ask=asks)

    ball = Piece(lesion=0.008, cell=0.018)
    soft, stiff = Stuff(mu=(1000.0,)), Stuff(region="lesion", mu=(5000.0,))
    pressed_top = (FOOT, Given(boundary="top", by=(0, 0, -0.002)))
    bar = Piece(size=(0.02, 0.02, 0.06), cell=CELL)
    shaken = Piece(size=(0.06, 0.03, 0.06), lesion=0.008, at=(0, 0, 0.03), cell=CELL)
    lossy = (Stuff(mu=(3000.0,), loss=0.3), Stuff(region="lesion", mu=(9000.0,), loss=0.3))
    centre = Ask(quantity="displacement", point=(0, 0, 0.03), direction=(1, 0, 0))

    def stretched(mm: float, stuff: Stuff) -> Loading:
        given = (FOOT, Given(boundary="top", by=(0, 0, mm / 1000)))
        return Loading(piece=bar, stuff=(stuff,), given=given, ask=(Ask(boundary="top"),))

    budday = Stuff(mu=(1442.0,), alpha=(-19.0,))
    fibred = Stuff(mu=(1000.0,), k1=4000.0, k2=2.0, fibre=(0, 0, 1))
    slanted = Stuff(mu=(1000.0,), k1=4000.0, k2=2.0, fibre=(1, 0, 1))
    sheared = Loading(
        piece=bar,
        stuff=(slanted,),
        given=(FOOT, Given(boundary="top", by=(0.006, 0, 0))),
        ask=(Ask(boundary="top", direction=(1, 0, 0)),),
    )
    wide = Loading(
        piece=Piece(size=(0.12, 0.12, 0.04), plate=(0.02, 0.02), cell=0.02),
        stuff=(soft,),
        given=(FOOT, Given(boundary="plate", by=(0, 0, -0.001))),
        ask=(on_plate,),
    )
    slid = Loading(
        piece=Piece(plate=(0.03, 0.024), cell=0.02),
        stuff=(Stuff(mu=(350.0,), alpha=(-10.0,)),),
        given=(FOOT, Given(boundary="plate", by=(0, 0, -0.003), hold="touching")),
        ask=(on_plate,),
    )
    dull = tuple(Stuff(region=region, mu=(mu,), loss=0.5) for region, mu in ((".*", 3000.0), ("lesion", 9000.0)))
    aslant = Loading(
        piece=Piece(size=(0.05, 0.03, 0.05), lesion=0.008, at=(0, 0, 0.025), cell=CELL),
        stuff=dull,
        given=(Given(boundary="left", by=(0, 0, 1e-4)),),
        course=Course(frequency=20),
        ask=(Ask(quantity="displacement", point=(0.01, 0, 0.025), direction=(0, 0, 1)),),
    )
    head = Piece(shape="head", cell=0.03)
    regions = (
        Stuff(mu=(600.0,)),
        Stuff(region="cortex", mu=(1400.0,)),
        Stuff(region="ventricle.*", mu=(10.0,), poisson=0.1),
    )
    tilted = Loading(
        piece=head,
        stuff=regions,
        given=SKULL,
        course=Course(gravity=(0.0, 0.7, -0.7)),
        ask=(Ask(quantity="displacement", point=(0.03, 0, 0.02), direction=(0, 1, -1)),),
    )
    hanging = Loading(
        piece=Piece(size=(0.04, 0.04, 0.06), cell=CELL),
        stuff=(Stuff(mu=(2000.0,)),),
        given=(FOOT,),
        course=Course(gravity=(1.0, 0.0, 0.0)),
        ask=(Ask(quantity="displacement", point=(0, 0, 0.06), direction=(1, 0, 0)),),
    )
    pulled = Loading(
        piece=plate,
        stuff=(cortex,),
        given=(FOOT,),
        pull=(Pull(boundary="plate", traction=(0, 0, -400.0)),),
        course=Course(ramp=1, elapsed=600),
        ask=(Ask(quantity="displacement", point=(0, 0, 0.04), direction=(0, 0, -1)),),
    )
    aside = (FOOT, Given(boundary="top", by=(0.001, 0, 0)))
    struck = Loading(
        piece=bar,
        stuff=(soft,),
        given=aside,
        course=Course(ramp=0.03, elapsed=0.03),
        ask=(Ask(boundary="top", direction=(1, 0, 0)),),
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
        "plate 2 mm, 1 s, sliding": Case(pressed(2, 1, 1, "touching"), RICH),
        "plate 3 mm, sliding, alpha -10": Case(slid, RICH),
        "plate 6 mm, an hour": Case(pressed(6, 10, 3600), RICH),
        "plate of 400 Pa, 10 min": Case(pulled, RICH),
        "retraction 2 mm, 10 s": Case(spread(2, 10, 10), RICH),
        "retraction 10 mm, 10 s": Case(spread(10, 10, 10), RICH),
        "retraction 5 mm, an hour": Case(spread(5, 10, 3600), RICH),
        "thin cleft, 0.5 mm": Case(spread(0.5, 1, 1, Piece(slot=(0.001, 0.02), cell=CELL)), RICH),
        "stiff lesion": Case(
            Loading(
                piece=ball,
                stuff=(soft, stiff),
                given=pressed_top,
                ask=(Ask(boundary="top"), Ask(quantity="strain", region="lesion", percentile=50)),
            ),
            RICH,
        ),
        "wave of 50 Hz": Case(
            Loading(
                piece=shaken,
                stuff=lossy,
                given=(Given(boundary="bottom", by=(1e-4, 0, 0)),),
                course=Course(frequency=50),
                ask=(centre,),
            ),
            RICH,
        ),
        "wave of 20 Hz": Case(aslant, RICH),
        "wave of 5 Hz": Case(
            Loading(
                piece=shaken,
                stuff=lossy,
                given=(Given(boundary="bottom|top", by=(1e-4, 0, 0)),),
                course=Course(frequency=5),
                ask=(centre,),
            ),
            RICH,
        ),
        "gravity, head": Case(tilted, RICH),
        "gravity, block on its side": Case(hanging, RICHER),
    }


def drawn(seed: int) -> Case:
    """Site, blade, rate and tissue at random."""
    random = np.random.default_rng(seed)
    tissue = Stuff(constants=str(random.choice([CORTEX, WHITE, "griffiths2024:deep_grey"])))
    ramp, far = float(10 ** random.uniform(-1, 1.5)), float(random.uniform(0.5, 6) / 1000)
    elapsed = ramp + float(10 ** random.uniform(-1, 3.5))
    course, tissues = Course(ramp=ramp, elapsed=elapsed), [tissue]
    if random.random() < 0.5:
        width = float(random.uniform(0.012, 0.028))
        lesion = float(random.uniform(0.004, 0.008)) if random.random() < 0.5 else None
        piece = Piece(plate=(width, width), lesion=lesion, at=(0, 0, 0.017), cell=CELL)
        if lesion:
            modulus = float(tissue.initial_modulus * random.choice([0.3, 4.0]))
            tissues.append(Stuff(region="lesion", mu=(modulus,)))
        given, ask = (FOOT, Given(boundary="plate", by=(0, 0, -far))), Ask(boundary="plate")
    else:
        depth = float(random.uniform(0.012, 0.028))
        piece = Piece(slot=(float(random.uniform(0.002, 0.006)), depth), cell=CELL)
        given = (FOOT, Given(boundary="wall_plus", by=(far, 0, 0)))
        ask = Ask(boundary="wall_plus", direction=(1, 0, 0))
    return Case(Loading(piece=piece, stuff=tuple(tissues), given=given, course=course, ask=(ask,)), RICH)
