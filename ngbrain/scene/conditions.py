# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""How a body is held and loaded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ngbrain.fields import Section, choice, number, pattern

if TYPE_CHECKING:
    from ngbrain.scene import Scene

MOST_TRACTION, MOST_ACCELERATION = 1e9, 1e5
"""Pa; m/s²."""


@dataclass(frozen=True, kw_only=True)
class DisplacementBC(Section):
    """A prescribed displacement (m) of the boundaries that match a pattern; 0 holds them.

    Parameters
    ----------
    boundary
        A name or a regular expression.
    value
        The displacement along x, y and z, which grows with the loads.
    components
        Those that are prescribed, out of "xyz"; others are free.
    contact
        bonded: the boundary sticks to what holds or moves it; frictionless: a rigid face pushes it, along which it may slide and
        from which it may part; sliding: it slides along what holds it, and does not part.
    """

    KEY = "displacement_bc"

    boundary: str = pattern("boundary")
    value: tuple[float, float, float] = number("value_mm", (0.0, 0.0, 0.0), signed=True, size=3)
    components: str = choice("components", "xyz", ["x", "y", "z", "xy", "xz", "yz", "xyz"])
    contact: str = choice("contact", "bonded", ["bonded", "frictionless", "sliding"])

    def _check(self, path: str, scene: Scene) -> None:
        if scene.cleft is not None:
            wanted = "bonded or sliding: in an operation only the tool pushes"
            self._need(self.contact != "frictionless", path, "contact", wanted)
            self._need(not any(self.value), path, "value", "0 in each place: in an operation only the tool moves")
            self._need(self.components == "xyz", path, "components", "'xyz': in an operation all of them are held")
            return
        self._need(self.contact != "sliding", path, "contact", "bonded or frictionless, but in an operation")
        if self.contact == "frictionless":
            self._need(scene.time.frequency is None, path, "contact", "'bonded': a wave's tissue does not part")
            self._need(
                self.components == "xyz", path, "components", "'xyz': a rigid face's motion is known in all of them"
            )
            self._need(any(self.value), path, "value", "not 0 in each place: a frictionless face has to push")


@dataclass(frozen=True, kw_only=True)
class Traction(Section):
    """A dead load on the boundaries that match a pattern.

    Parameters
    ----------
    boundary
        A name or a regular expression.
    value
        Force over area at rest (Pa) along x, y and z.
    """

    boundary: str = pattern("boundary")
    value: tuple[float, float, float] = number("value_Pa", signed=True, size=3)

    def _check(self, path: str, scene: Scene) -> None:
        self._need(max(map(abs, self.value)) <= MOST_TRACTION, path, "value", f"at most {MOST_TRACTION:g} Pa")


@dataclass(frozen=True, kw_only=True)
class Gravity(Section):
    """Weight that acts on the body, from a state in which there was none; it grows with the loads.

    Parameters
    ----------
    acceleration
        Along x, y and z (m/s²); 9.81 downwards is -9.81 along z.
    """

    acceleration: tuple[float, float, float] = number("acceleration_m_s2", signed=True, size=3)

    def _check(self, path: str, scene: Scene) -> None:
        wanted = f"an acceleration of at most {MOST_ACCELERATION:g} m/s², not all 0"
        largest = max(map(abs, self.acceleration))
        self._need(0 < largest <= MOST_ACCELERATION, path, "acceleration", wanted)
        self._need(scene.time.frequency is None, path, "acceleration", "no [gravity] of a wave: it has none")
