# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""Rigid bodies in contact with a boundary."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass
from typing import TYPE_CHECKING, Any

from ngbrain.scene.conditions import Given, depends_on_time
from ngbrain.schema.document import Section
from ngbrain.schema.fields import choice, formula, number, pattern
from ngbrain.schema.formulas import FUNCTIONS, Formula

if TYPE_CHECKING:
    from ngbrain.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Contact(Section):
    """A rigid body in unilateral contact with the boundaries that match a pattern.

    Parameters
    ----------
    boundary
        A name or a regular expression.
    shape
        ball; cylinder, without ends; plane: the half space behind a plane.
    point
        Initial position: the centre of a ball, a point on a cylinder's axis or on a plane.
    direction
        Of a cylinder's axis; of a plane its normal, from the rigid body to the tissue.
    radius
        Of a ball or a cylinder.
    travel
        Displacement of the body along x, y and z: for each a number, which grows with the loads, or a formula of t, which holds at
        every moment.
    friction
        Coefficient of Coulomb friction.
    """

    boundary: str = pattern("boundary")
    shape: str = choice("shape", MISSING, ["ball", "cylinder", "plane"])
    point: tuple[float, float, float] = number("point_mm", signed=True, size=3)
    direction: tuple[float, float, float] | None = number("direction", None, signed=True, size=3)
    radius: float | None = number("radius_mm", None)
    travel: tuple[Given, Given, Given] = formula("travel_mm", (0.0, 0.0, 0.0), ("t",), "t (s)", size=3)
    friction: float = number("friction", 0.0, least=0.0)

    def _check(self, path: str, scene: Scene) -> None:
        flat = self.shape == "plane"
        self._need((self.radius is None) == flat, path, "radius", "a radius for a ball or a cylinder, none for a plane")
        wanted = "a direction for a cylinder or a plane, none for a ball"
        self._need((self.direction is None) == (self.shape == "ball"), path, "direction", wanted)
        self._need(self.direction is None or any(self.direction), path, "direction", "a direction: not all 0")
        self._need(self.friction <= 1, path, "friction", "at most 1: the largest tangential over the normal force")
        self._need(
            scene.time.frequency is None, path, "shape", "no [[contact]]: in a harmonic problem tissue cannot separate"
        )
        timed = [depends_on_time(each) for each in self.travel if each]
        alike = not self.friction or all(timed) or not any(timed)
        self._need(alike, path, "travel", "all numbers or all formulas of t, for a body with friction")

    @property
    def is_timed(self) -> bool:
        """Whether a formula prescribes its motion as a function of time."""
        return any(map(depends_on_time, self.travel))

    def displacement(
        self, t: Any, growth: Any, functions: Mapping[str, Callable[..., Any]] = FUNCTIONS
    ) -> tuple[Any, Any, Any]:
        """Displacement of the rigid body.

        Parameters
        ----------
        t : float, array or field
            Time (s).
        growth : float, array or field
            Fraction of the loads that is applied.
        functions : mapping of callable, optional
            Functions of formulas, for numbers and arrays by default.

        Returns
        -------
        tuple
            Components along x, y and z (m).
        """
        x, y, z = (
            1e-3 * each({"t": t}, functions) * (1.0 if depends_on_time(each) else growth)
            if isinstance(each, Formula)
            else each * growth
            for each in self.travel
        )
        return x, y, z
