# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""The requested quantities of a scene, and their tolerances."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass
from typing import TYPE_CHECKING

from ngbrain.schema.document import Section
from ngbrain.schema.fields import choice, number, pattern, text

if TYPE_CHECKING:
    from ngbrain.scene import Scene

OF_BODIES = ("force", "displacement", "strain")
"""Quantities of a body under loads."""
OF_OPERATIONS = (
    "peak_pressure_mmHg",
    "peak_tip_pressure_mmHg",
    "peak_force_N",
    "dose_mmHg_min",
    *(f"{strain}_p{percent}" for strain in ("mps", "oss") for percent in (50, 95, 99)),
)
"""Quantities of an operation's protocol."""
UNITS = {"force": "N", "displacement": "m", "strain": "", "mmHg_min": "mmHg min", "mmHg": "mmHg", "N": "N"}
"""Unit by the name of a body's quantity, or by the suffix of an operation's."""


@dataclass(frozen=True, kw_only=True)
class Quantity(Section):
    """A quantity of interest, with the tolerated relative error.

    Parameters
    ----------
    name
        force: of a boundary, along a direction (N); displacement: of a point, along a direction (m); strain: a percentile of the
        maximum principal strain (Green-Lagrange) in the regions that match a pattern, within a radius of a point if one is given;
        in a harmonic problem the amplitude of each. For an operation, a result of a protocol, such as peak_pressure_mmHg.
    boundary
        Of a force: a name or a regular expression.
    direction
        Of a force or a displacement; along z by default.
    point
        Of a displacement, or the centre of the region of a strain.
    region
        Of a strain: a name or a regular expression.
    radius
        Radius of the region of a strain, around the point; everywhere by default.
    percentile
        Of a strain, by volume.
    when
        end: at the end; ramp: at the end of the load ramp.
    protocol
        Name of an operation's protocol; the first one by default.
    tolerance
        Relative error.
    """

    name: str = choice("name", MISSING, [*OF_BODIES, *OF_OPERATIONS])
    boundary: str | None = pattern("boundary", None)
    direction: tuple[float, float, float] | None = number("direction", None, signed=True, size=3)
    point: tuple[float, float, float] | None = number("point_mm", None, signed=True, size=3)
    region: str = pattern("region", ".*")
    radius: float | None = number("radius_mm", None)
    percentile: float = number("percentile", 95.0)
    when: str = choice("when", "end", ["end", "ramp"])
    protocol: str | None = text("protocol", None, "the name of a protocol", lambda raw: raw.strip())
    tolerance: float = number("tolerance", 0.05)

    def _check(self, path: str, scene: Scene) -> None:
        known = OF_BODIES if scene.cleft is None else OF_OPERATIONS
        of = "a body under loads" if scene.cleft is None else "an operation"
        self._need(self.name in known, path, "name", f"one of {', '.join(known)}, of {of}")
        self._need(1e-4 <= self.tolerance <= 1, path, "tolerance", "a relative error of 0.0001 to 1")
        if scene.cleft is not None:
            names = [protocol.name for protocol in scene.protocols]
            self._need(self.protocol in (None, *names), path, "protocol", f"one of {', '.join(names)}")
            return
        self._need(self.protocol is None, path, "protocol", "this key left out: only an operation has protocols")
        wanted = "a boundary for a force, and for no other quantity"
        self._need((self.boundary is None) == (self.name != "force"), path, "boundary", wanted)
        wanted = "a direction of a force or a displacement, not all 0"
        self._need(self.direction is None or (any(self.direction) and self.name != "strain"), path, "direction", wanted)
        needs_point = self.name == "displacement" or self.radius is not None
        self._need(self.point is not None or not needs_point, path, "point", "a point to go with it")
        self._need(self.percentile <= 100, path, "percentile", "at most 100")
        of_wave = scene.time.frequency is not None and self.when == "ramp"
        self._need(not of_wave, path, "when", "'end': amplitudes of a harmonic problem have no ramp")

    @property
    def unit_vector(self) -> tuple[float, float, float]:
        """Unit vector of the direction; along z by default."""
        x, y, z = self.direction or (0.0, 0.0, 1.0)
        size = math.hypot(x, y, z)
        return x / size, y / size, z / size

    @property
    def unit(self) -> str:
        """Unit of its value; empty for a strain."""
        return next((unit for end, unit in UNITS.items() if self.name == end or self.name.endswith(f"_{end}")), "")

    @property
    def where(self) -> str:
        """Boundary, point or regions of a body's quantity, or protocol of an operation's; empty for the first protocol."""
        if self.name not in OF_BODIES:
            return self.protocol or ""
        place = ", ".join(f"{1e3 * c:g}" for c in self.point or ())
        near = "" if self.radius is None else f" within {1e3 * self.radius:g} mm of {place} mm"
        return {"force": self.boundary or "", "displacement": f"{place} mm"}.get(self.name, self.region + near)

    @property
    def moment(self) -> str:
        """Time of a body's quantity; empty for an operation's, which refers to a whole protocol."""
        return self.when if self.name in OF_BODIES else ""

    @property
    def label(self) -> str:
        """Unique description."""
        if self.name not in OF_BODIES:
            return self.name + (f" of {self.protocol}" if self.protocol else "")
        if self.name == "strain":
            return f"strain p{self.percentile:g} in {self.where}, {self.when}"
        along = f" along {', '.join(f'{c:g}' for c in self.direction)}" if self.direction else ""
        along = "" if self.direction == (0, 0, 1) else along
        return f"{self.name} {'on' if self.name == 'force' else 'at'} {self.where}{along}, {self.when}"
