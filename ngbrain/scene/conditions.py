# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""Supports and loads of a body."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass
from typing import TYPE_CHECKING, Any

from ngbrain.schema.document import Section
from ngbrain.schema.fields import choice, formula, number, pattern
from ngbrain.schema.formulas import FUNCTIONS, Formula
from ngbrain.units import LARGEST_BODY

if TYPE_CHECKING:
    from ngbrain.scene import Scene

MOST_TRACTION, MOST_ACCELERATION, MOST_TURN = 1e9, 1e5, 720.0
"""Upper limits: Pa; m/s²; degrees."""
FLUIDS = (100.0, 5000.0)
"""Densities of fluids (kg/m³)."""
PLACE, ABOUT = ("x", "y", "z", "t"), "x, y, z (mm) and t (s)"
"""Variables of a formula in space and time, and their description."""
Given = float | Formula
Functions = Mapping[str, Callable[..., Any]]


def evaluate_at(given: Given, place: Sequence[Any], t: Any, functions: Functions = FUNCTIONS) -> Any:
    """Evaluate a prescribed value.

    Parameters
    ----------
    given : float or Formula
    place : sequence
        Coordinates x, y, z (m): numbers, arrays or fields.
    t : float, array or field
        Time (s).
    functions : mapping of callable, optional
        Functions of formulas, for numbers and arrays by default.

    Returns
    -------
    float, array or field
        In the unit of the TOML key.
    """
    if not isinstance(given, Formula):
        return given
    x, y, z = (1e3 * each for each in place)
    return given({"x": x, "y": y, "z": z, "t": t}, functions)


def depends_on_time(given: Any) -> bool:
    """Whether a value is a formula of time, which holds at every moment; any other value grows with the loads."""
    return isinstance(given, Formula) and "t" in given.variables


@dataclass(frozen=True, kw_only=True)
class DisplacementBC(Section):
    """A prescribed displacement (m) of the boundaries that match a pattern; 0 fixes them.

    Parameters
    ----------
    boundary
        A name or a regular expression.
    value
        The displacement along x, y and z: of each a number, or a formula such as "0.1*x*sin(2*pi*t)" of the place at rest, x, y, z
        in mm, and of time, t in s, that gives mm. Numbers and formulas without t grow with the loads; one of t is the displacement
        at every moment, and 0 at t = 0.
    components
        The prescribed components, out of "xyz"; others are free.
    contact
        bonded: all prescribed components are enforced; frictionless: a rigid face pushes the boundary, which may slide along it and
        separate from it; sliding: the boundary slides along a fixed surface and does not separate.
    rotation
        Angle by which the boundary is turned as a rigid plate, before it is displaced by the value: a number, which grows with the
        loads, or a formula of t.
    axis
        Direction of the rotation's axis, right-handed.
    centre
        A point on that axis; the origin by default.
    """

    KEY = "displacement_bc"

    boundary: str = pattern("boundary")
    value: tuple[Given, Given, Given] = formula("value_mm", (0.0, 0.0, 0.0), PLACE, ABOUT, size=3)
    components: str = choice("components", "xyz", ["x", "y", "z", "xy", "xz", "yz", "xyz"])
    contact: str = choice("contact", "bonded", ["bonded", "frictionless", "sliding"])
    rotation: Given | None = formula("rotation_deg", None, ("t",), "t (s)")
    axis: tuple[float, float, float] | None = number("axis", None, signed=True, size=3)
    centre: tuple[float, float, float] | None = number("centre_mm", None, signed=True, size=3)

    def _check(self, path: str, scene: Scene) -> None:
        self._check_rotation(path, scene)
        if scene.cleft is not None:
            wanted = "bonded or sliding: in an operation only the tool pushes"
            self._need(self.contact != "frictionless", path, "contact", wanted)
            self._need(not any(self.value), path, "value", "all 0: in an operation only the tool moves")
            self._need(
                self.rotation is None, path, "rotation", "this key left out: in an operation only the tool moves"
            )
            self._need(self.components == "xyz", path, "components", "'xyz': in an operation all components are fixed")
            return
        if self.contact == "sliding":
            wanted = "bonded or frictionless: in a harmonic problem boundaries are bonded"
            self._need(scene.time.frequency is None, path, "contact", wanted)
            self._need(
                self.components == "xyz", path, "components", "'xyz': a sliding boundary keeps to its own surface"
            )
            self._need(
                not any(self.value), path, "value", "all 0: the surface along which a boundary slides is at rest"
            )
        if self.contact == "frictionless":
            self._need(
                scene.time.frequency is None,
                path,
                "contact",
                "'bonded', as in a harmonic problem tissue cannot separate",
            )
            self._need(
                self.components == "xyz", path, "components", "'xyz': the motion of a rigid face has all components"
            )
            self._need(self.is_even, path, "value", "numbers: a frictionless face moves along a straight line")
            self._need(any(self.value), path, "value", "not all 0: a frictionless face has to push the boundary")
        in_time = scene.time.frequency is not None and any(map(depends_on_time, self.value))
        self._need(
            not in_time, path, "value", "numbers or formulas of x, y, z: in a harmonic problem they are amplitudes"
        )

    def _check_rotation(self, path: str, scene: Scene) -> None:
        turns = self.rotation is not None
        self._need((self.axis is None) != turns, path, "axis", "a direction to go with rotation_deg, and only with it")
        self._need(self.centre is None or turns, path, "centre", "a point to go with rotation_deg, and only with it")
        if not turns:
            return
        self._need(any(self.axis or ()), path, "axis", "a direction: not all 0")
        self._need(
            scene.time.frequency is None,
            path,
            "rotation",
            "this key left out: a harmonic problem has displacement amplitudes only",
        )
        self._need(self.components == "xyz", path, "components", "'xyz': a rotation has all components")
        self._need(self.contact == "bonded", path, "contact", "'bonded', for a rotated boundary")
        if not isinstance(self.rotation, Formula):
            fits = 0 < abs(self.rotation or 0.0) <= MOST_TURN
            self._need(fits, path, "rotation", f"an angle of at most {MOST_TURN:g} degrees, not 0")

    @property
    def is_even(self) -> bool:
        """Whether it is constant over the boundary and grows with the loads."""
        return self.rotation is None and not any(isinstance(each, Formula) for each in self.value)

    @property
    def has_course(self) -> bool:
        """Whether it is not simply proportional to the loads."""
        return self.rotation is not None or any(map(depends_on_time, self.value))

    @property
    def is_timed(self) -> bool:
        """Whether a formula prescribes it as a function of time."""
        return any(map(depends_on_time, (self.rotation, *self.value)))

    def displacement(self, place: Sequence[Any], t: Any, growth: Any, functions: Functions = FUNCTIONS) -> list[Any]:
        """Prescribed displacement.

        Parameters
        ----------
        place : sequence
            Coordinates x, y, z (m) at rest: numbers, arrays or fields.
        t : float, array or field
            Time (s).
        growth : float, array or field
            Fraction of the loads that is applied.
        functions : mapping of callable, optional
            Functions of formulas, for numbers and arrays by default.

        Returns
        -------
        list
            Components along x, y and z (m).
        """
        moved = [
            1e-3 * evaluate_at(each, place, t, functions) * (1.0 if depends_on_time(each) else growth)
            if isinstance(each, Formula)
            else each * growth
            for each in self.value
        ]
        if self.rotation is None:
            return moved
        turn = self.rotation
        angle = math.pi / 180 * (turn({"t": t}, functions) if isinstance(turn, Formula) else turn * growth)
        if isinstance(turn, Formula) and not depends_on_time(turn):
            angle = angle * growth
        size = math.hypot(*(self.axis or ()))
        k = [each / size for each in self.axis or ()]
        r = [each - middle for each, middle in zip(place, self.centre or (0.0, 0.0, 0.0), strict=True)]
        along = k[0] * r[0] + k[1] * r[1] + k[2] * r[2]
        cross = [k[1] * r[2] - k[2] * r[1], k[2] * r[0] - k[0] * r[2], k[0] * r[1] - k[1] * r[0]]
        half, sine = functions["sin"](angle / 2), functions["sin"](angle)  # 1 - cos without cancellation
        return [u - 2 * half * half * (a - n * along) + sine * c for u, a, n, c in zip(moved, r, k, cross, strict=True)]


@dataclass(frozen=True, kw_only=True)
class Traction(Section):
    """A dead load on the boundaries that match a pattern.

    Parameters
    ----------
    boundary
        A name or a regular expression.
    value
        Force over area at rest (Pa) along x, y and z: of each a number or a formula, as of a displacement.
    """

    boundary: str = pattern("boundary")
    value: tuple[Given, Given, Given] = formula("value_Pa", MISSING, PLACE, ABOUT, size=3)

    def _check(self, path: str, scene: Scene) -> None:
        numbers = [abs(each) for each in self.value if not isinstance(each, Formula)]
        self._need(max(numbers, default=0) <= MOST_TRACTION, path, "value", f"at most {MOST_TRACTION:g} Pa")
        in_time = scene.time.frequency is not None and any(map(depends_on_time, self.value))
        self._need(
            not in_time, path, "value", "numbers or formulas of x, y, z: in a harmonic problem they are amplitudes"
        )


@dataclass(frozen=True, kw_only=True)
class Pressure(Section):
    """A follower pressure, such as that of a fluid, on the boundaries that match a pattern.

    Parameters
    ----------
    boundary
        A name or a regular expression.
    value
        Force over current area (Pa), into the body; negative values are suction. A number or a formula, as of a displacement.
    """

    boundary: str = pattern("boundary")
    value: Given = formula("value_Pa", MISSING, PLACE, ABOUT)

    def _check(self, path: str, scene: Scene) -> None:
        fits = isinstance(self.value, Formula) or abs(self.value) <= MOST_TRACTION
        self._need(fits, path, "value", f"at most {MOST_TRACTION:g} Pa")
        self._need(
            scene.time.frequency is None,
            path,
            "value",
            "a [[traction]]: in a harmonic problem pressures do not follow the surface",
        )


@dataclass(frozen=True, kw_only=True)
class Gravity(Section):
    """Gravity. A body is loaded as its loads grow; an operation's head is loaded, and settles, before the tool touches it.

    Parameters
    ----------
    acceleration
        Along x, y and z (m/s²); 9.81 downwards is -9.81 along z.
    imaged
        Acceleration (m/s²) in which the body was imaged: its shape is taken as stress-free there, with all of the fluid, and only
        the difference loads it. 0, a shape that is stress-free without gravity, if it is left out.
    """

    acceleration: tuple[float, float, float] = number("acceleration_m_s2", signed=True, size=3)
    imaged: tuple[float, float, float] | None = number("imaged_acceleration_m_s2", None, signed=True, size=3)

    def _check(self, path: str, scene: Scene) -> None:
        wanted = f"an acceleration of at most {MOST_ACCELERATION:g} m/s², not all 0"
        largest = max(map(abs, self.acceleration))
        self._need(0 < largest <= MOST_ACCELERATION, path, "acceleration", wanted)
        largest = max(map(abs, self.imaged or (0.0,)))
        self._need(largest <= MOST_ACCELERATION, path, "imaged", f"at most {MOST_ACCELERATION:g} m/s²")
        self._need(scene.time.frequency is None, path, "acceleration", "no [gravity]: a harmonic problem has none")


@dataclass(frozen=True, kw_only=True)
class Fluid(Section):
    """A fluid at rest around the body, such as cerebrospinal fluid: it lifts the body, with `[gravity]`.

    Parameters
    ----------
    density
        Mass over volume.
    drained_to
        Height of its surface, the coordinate opposite to gravity: z where gravity points along -z. There is no fluid above. If it
        is left out, nothing is drained: the fluid fills the space around the body.
    """

    density: float = number("density_kg_m3")
    drained_to: float | None = number("drained_to_mm", None, signed=True)

    def _check(self, path: str, scene: Scene) -> None:
        low, high = FLUIDS
        self._need(low <= self.density <= high, path, "density", f"a density of {low:g} to {high:g} kg/m³")
        self._need(
            scene.gravity is not None, path, "density", "[gravity] to go with it: without, a fluid has no pressure"
        )
        far = self.drained_to is None or abs(self.drained_to) <= LARGEST_BODY
        self._need(far, path, "drained_to", f"a height of at most {1e3 * LARGEST_BODY:g} mm")
