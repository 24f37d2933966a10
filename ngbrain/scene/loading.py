# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""A body under loads as plain data: what it is made of, how it is held and loaded, and what is asked how accurately.

Beside `Scene`, which is an operation with a blade: here loads and displacements are given, from a piece of tissue under a plate to
a head that is tilted or shaken. The body's own axes are x, y and z (up).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ngbrain.fields import Document, Section, choice, number, pattern, table, text
from ngbrain.scene.tissues import Constitutive

GRAVITY = 9.81
"""m/s²."""
MOST_TRACTION = 1e9
"""Pa."""
POISSON, DENSITY = 0.49, 1040.0
"""Of tissue of which nothing else is known: Poisson's ratio for fast small strain, and density (kg/m³)."""


@dataclass(frozen=True, kw_only=True)
class Piece(Section):
    """The body: a block of tissue with its foot in the plane z = 0 and its middle at x = y = 0, the idealised head, or a mesh.

    file          of a mesh in space, as Netgen writes it (.vol, .vol.gz; m), with regions and boundaries of its own
    size          of the block along x, y and z (m)
    plate         sides along x and y (m) of a rectangle in the middle of the block's top, boundary "plate"
    lesion        radius (m) of a ball of its own region "lesion", with its centre `at` (m)
    slot          width between its walls (x) and depth (m) of a cut through the whole top, boundaries "wall_minus", "wall_plus"
    cell          size (m) of the coarsest elements

    A block has the region "tissue" and the boundaries left, right (x), front, back (y), bottom, top (z).
    """

    shape: str = choice("shape", "block", ["block", "head", "mesh"])
    file: str | None = text(
        "file", None, "the path of a mesh (.vol, .vol.gz)", lambda raw: raw.endswith((".vol", ".vol.gz"))
    )
    size: tuple[float, float, float] = number("size_mm", (0.06, 0.06, 0.04), size=3)
    plate: tuple[float, float] | None = number("plate_mm", None, size=2)
    lesion: float | None = number("lesion_mm", None)
    at: tuple[float, float, float] = number("at_mm", (0.0, 0.0, 0.02), signed=True, size=3)
    slot: tuple[float, float] | None = number("slot_mm", None, size=2)
    cell: float = number("cell_mm", 0.015, least=0.5)

    def _check(self, path: str, scene: Loading) -> None:
        x, y, z = self.size
        self._need(
            (self.file is None) == (self.shape != "mesh"), path, "file", "a file for shape = 'mesh', and only for it"
        )
        if self.shape != "block":
            for name in ("plate", "lesion", "slot"):
                self._need(getattr(self, name) is None, path, name, "this key left out: only a block has it")
            return
        plate, slot = self.plate or (0.0, 0.0), self.slot or (0.0, 0.0)
        self._need(plate[0] < x and plate[1] < y, path, "plate", f"less than the block's {1e3 * x:g} by {1e3 * y:g}")
        self._need(not (self.plate and self.slot), path, "slot", "this key or plate_mm, not both: they share the top")
        self._need(slot[0] < x / 2 and slot[1] < z, path, "slot", f"less than half of {1e3 * x:g}, and {1e3 * z:g}")
        r = self.lesion or 0.0
        inside = abs(self.at[0]) + r < x / 2 and abs(self.at[1]) + r < y / 2 and r < self.at[2] < z - r
        self._need(not r or inside, path, "lesion", "a ball inside the block, around at_mm")


@dataclass(frozen=True, kw_only=True)
class Stuff(Constitutive):
    """What the regions that match a pattern are made of, by `constants` or by `mu`: see `Constitutive`.

    alpha        left out: Neo-Hooke
    poisson      Poisson's ratio for fast small strain: bulk modulus K = 2μ₀(1 + ν)/3(1 - 2ν); None: the source's K or ν where
                 `constants` have one, else `POISSON`
    density      kg/m³; None: `DENSITY`
    loss         G″/G′ of waves, for tissue without branches
    k1, k2       fibres of Holzapfel, Gasser and Ogden: stiffness (Pa), and how fast it grows
    fibre        their direction
    map          path of a NIfTI volume of shear moduli (Pa) for fast small strain, in the body's own axes (mm): all moduli and
                 viscosities are in proportion to it, and only what they are to each other is taken from the above
    """

    region: str = pattern("region", ".*")
    poisson: float | None = number("poisson", None, least=0.0)
    density: float | None = number("density_kg_m3", None)
    loss: float = number("loss", 0.0, least=0.0)
    k1: float | None = number("k1_Pa", None)
    k2: float = number("k2", 1.0)
    fibre: tuple[float, float, float] | None = number("fibre", None, signed=True, size=3)
    map: str | None = text(
        "map", None, "the path of a volume (.nii, .nii.gz)", lambda raw: raw.endswith((".nii", ".nii.gz"))
    )

    def _check(self, path: str, scene: Loading) -> None:
        self._check_law(path)
        mu, alpha, eta, tau = self.mu or (), self.alpha or (), self.eta or (), self.tau or ()
        self._need(self.constants or mu, path, "mu", "this key or constants, a name in the catalogue")
        self._need(len(alpha) in (0, len(mu)) and all(alpha), path, "alpha", f"{len(mu)} values, none of them 0")
        times = "tau" if tau else "eta"
        self._need(not mu or len(eta or tau) < len(mu), path, times, f"fewer values than mu_Pa, {len(mu)}")
        self._check_sizes(path)
        self._need(self.poisson is None or self.poisson < 0.5, path, "poisson", "less than 0.5")
        self._need((self.k1 is None) == (self.fibre is None), path, "fibre", "a direction to go with k1_Pa")
        self._need(self.fibre is None or any(self.fibre), path, "fibre", "a direction: not all 0")

    @property
    def bulk(self) -> float:
        """Bulk modulus K (Pa)."""
        entry = self.published
        if self.poisson is None and entry and entry.bulk:
            return entry.bulk * (self.scale or 1.0)
        nu = self.poisson if self.poisson is not None else (entry and entry.poisson) or POISSON
        return 2 * self.initial_modulus * (1 + nu) / (3 * (1 - 2 * nu))

    @property
    def rho(self) -> float:
        """Density (kg/m³), the scene's or the one that is assumed."""
        return DENSITY if self.density is None else self.density

    @property
    def cautions(self) -> list[str]:
        """What to know of the constants, and what is assumed of the change of volume, in words."""
        entry = self.published
        if self.poisson is not None or (entry and (entry.bulk or entry.poisson)):
            return super().cautions
        return [*super().cautions, f"poisson is not given: {POISSON:g} is assumed, nearly incompressible"]


@dataclass(frozen=True, kw_only=True)
class Given(Section):
    """A displacement (m) that a boundary is moved by, all of it or some components; 0 holds it. Components left out are free.

    along   components that are given, out of "xyz"
    hold    tied: the boundary sticks to what moves it; touching: a rigid face pushes it, along which it may slide and from which it
            may part, without friction
    """

    boundary: str = pattern("boundary")
    by: tuple[float, float, float] = number("by_mm", (0.0, 0.0, 0.0), signed=True, size=3)
    along: str = choice("along", "xyz", ["x", "y", "z", "xy", "xz", "yz", "xyz"])
    hold: str = choice("hold", "tied", ["tied", "touching"])

    def _check(self, path: str, scene: Loading) -> None:
        pushed = any(self.by) and self.along == "xyz" and scene.course.frequency is None
        self._need(
            self.hold == "tied" or pushed, path, "hold", "'tied' of a wave, and where by_mm is 0 or not all given"
        )


@dataclass(frozen=True, kw_only=True)
class Pull(Section):
    """A dead load (Pa) on a boundary."""

    boundary: str = pattern("boundary")
    traction: tuple[float, float, float] = number("traction_Pa", signed=True, size=3)

    def _check(self, path: str, scene: Loading) -> None:
        self._need(max(map(abs, self.traction)) <= MOST_TRACTION, path, "traction", f"at most {MOST_TRACTION:g} Pa")


@dataclass(frozen=True, kw_only=True)
class Course(Section):
    """How loads and displacements grow: evenly in `ramp` (s), then they stay until `elapsed` (s); or a wave's frequency (Hz).

    gravity     direction in which the body's weight acts once it is turned, from where it did not matter: the load that is
                asked for is ρg times this vector
    """

    ramp: float = number("ramp_s", 1.0)
    elapsed: float = number("elapsed_s", 10.0)
    frequency: float | None = number("frequency_Hz", None)
    gravity: tuple[float, float, float] | None = number("gravity", None, signed=True, size=3)

    def _check(self, path: str, scene: Loading) -> None:
        self._need(self.elapsed >= self.ramp, path, "elapsed", f"at least {self.ramp:g}, course.ramp_s")
        wanted = "this key left out: waves have displacements and tractions alone"
        self._need(self.frequency is None or self.gravity is None, path, "gravity", wanted)


QUANTITIES = ("force", "displacement", "strain")
"""What can be asked for."""


@dataclass(frozen=True, kw_only=True)
class Ask(Section):
    """A question, with the relative error that its answer may have.

    quantity    force: of a boundary, along a direction (N); displacement: of a point, along a direction (m); strain: a percentile
                of the largest principal strain (Green-Lagrange) in the regions that match a pattern, within a distance of a point
                if one is given. Of a wave: the amplitude of each
    when        end: at the end; ramp: when the loads have just got their size
    """

    quantity: str = choice("quantity", "force", QUANTITIES)
    boundary: str = pattern("boundary", ".*")
    direction: tuple[float, float, float] = number("direction", (0.0, 0.0, 1.0), signed=True, size=3)
    point: tuple[float, float, float] | None = number("point_mm", None, signed=True, size=3)
    region: str = pattern("region", ".*")
    within: float | None = number("within_mm", None)
    percentile: float = number("percentile", 95.0)
    when: str = choice("when", "end", ["end", "ramp"])
    tolerance: float = number("tolerance", 0.05)

    def _check(self, path: str, scene: Loading) -> None:
        self._need(any(self.direction), path, "direction", "a direction: not all 0")
        needs_point = self.quantity == "displacement" or self.within is not None
        self._need(self.point is not None or not needs_point, path, "point", "a point to go with it")
        self._need(self.percentile <= 100, path, "percentile", "at most 100")
        of_wave = scene.course.frequency is not None and self.when == "ramp"
        self._need(not of_wave, path, "when", "'end': the amplitude of a wave has no ramp")
        self._need(1e-4 <= self.tolerance <= 1, path, "tolerance", "a relative error of 0.0001 to 1")

    @property
    def unit_vector(self) -> tuple[float, ...]:
        """The direction, of length 1."""
        size = math.hypot(*self.direction)
        return tuple(component / size for component in self.direction)

    @property
    def name(self) -> str:
        """In words, different for different questions."""
        place = ", ".join(f"{1e3 * c:g}" for c in self.point or ())
        if self.quantity == "strain":
            near = "" if self.within is None else f" within {1e3 * self.within:g} mm of {place} mm"
            return f"strain p{self.percentile:g} in {self.region}{near}, {self.when}"
        along = "" if self.direction == (0, 0, 1) else f" along {', '.join(f'{c:g}' for c in self.direction)}"
        what = f"force on {self.boundary}" if self.quantity == "force" else f"displacement at {place} mm"
        return f"{what}{along}, {self.when}"


@dataclass(frozen=True, kw_only=True)
class Loading(Document):
    """A body under loads. Whatever is wrong with it raises `InputError`.

    >>> scene = Loading(
    ...     stuff=[Stuff(mu=1000.0)],
    ...     given=[Given(boundary="bottom"), Given(boundary="top", by=(0, 0, -1e-3))],
    ...     ask=[Ask(boundary="top", tolerance=0.05)],
    ... )
    >>> scene.ask[0].name, Loading.from_dict(scene.to_dict()) == scene
    ('force on top, end', True)
    """

    title: str = text("title", "", "one line of text", lambda raw: True)
    piece: Piece = table(Piece, Piece)
    stuff: tuple[Stuff, ...] = table(Stuff, size=0)
    given: tuple[Given, ...] = table(Given, size=0)
    pull: tuple[Pull, ...] | None = table(Pull, None, size=0)
    course: Course = table(Course, Course)
    ask: tuple[Ask, ...] = table(Ask, size=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("piece", "course"):
            getattr(self, name)._check(name, self)
        for name in ("stuff", "given", "pull", "ask"):
            for i, part in enumerate(getattr(self, name) or (), 1):
                part._check(f"{name}#{i}", self)
        names = [ask.name for ask in self.ask]
        for i, ask in enumerate(self.ask, 1):
            ask._need(
                ask.name not in names[: i - 1],
                f"ask#{i}",
                "quantity",
                f"another question: {ask.name!r} is asked already",
            )

    @property
    def warnings(self) -> list[str]:
        """What is assumed of the tissues, and what to know of their constants, a line each."""
        found = list[str]()
        for i, stuff in enumerate(self.stuff, 1):
            said, waves = stuff.cautions, self.course.frequency is not None
            if waves and not stuff.loss and not stuff.law().branches:
                said = [*said, "it neither relaxes nor has a loss: waves in it do not fade"]
            found += [f"stuff#{i} ({stuff.region}): {caution}" for caution in said]
        return found
