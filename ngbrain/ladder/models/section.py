"""Whether a plane section or a region of interest can represent a scene."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Protocol

from ngbrain.ladder.models.geometry import CUT, OF_SECTION, region_of_interest
from ngbrain.scene import Pressure, Scene, Traction
from ngbrain.scene.conditions import Given
from ngbrain.schema.formulas import Formula

ACROSS = ("front", "back")
"""Sides of a block that its section does not have."""
SHORTER = ("top", "bottom")
"""Sides of a block that a region of interest contains in part."""
IN_PLANE = 1e-9
"""Relative size of an out-of-plane component within round-off."""


class Labelled(Protocol):
    """Something with a label, such as a requested quantity."""

    @property
    def label(self) -> str:
        """Description."""


def not_in_section(scene: Scene, questions: Sequence[Labelled] = ()) -> str | None:
    """Why the section y = 0 cannot represent a scene, such as a loaded face or a vector along y; None where it can.

    A fibre may lie in the section or along y: an oblique one shears the body out of the plane.

    Parameters
    ----------
    scene : Scene
    questions : sequence of Question

    Returns
    -------
    str or None

    Examples
    --------
    >>> from ngbrain.scene import DisplacementBC, Geometry, Quantity, Tissue
    >>> scene = Scene(
    ...     geometry=Geometry(kind="block", size=(0.06, 0.06, 0.04)),
    ...     tissues=[Tissue(mu=1e3)],
    ...     displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 1e-3, 1e-3))],
    ...     quantities=[Quantity(name="force", boundary="top")],
    ... )
    >>> not_in_section(scene)
    "the displacement of 'top' has a component along y"
    """
    for question in questions:
        return f"the requested {question.label!r} is of a 3-D body"
    loads: list[Traction | Pressure] = [*scene.tractions, *scene.pressures]
    patterns = [load.boundary for load in loads] + [body.boundary for body in scene.contacts]
    patterns += [str(quantity.boundary) for quantity in scene.quantities if quantity.name == "force"]
    for pattern in patterns:
        known = [name for name in (*OF_SECTION, *ACROSS) if re.fullmatch(pattern, name)]
        if not known or set(known) & set(ACROSS):
            return f"a section has no {known[-1] if known else pattern!r}"
    for body in scene.contacts:
        x, y, z = body.direction or (0.0, 0.0, 0.0)
        across = {"plane": abs(y), "cylinder": math.hypot(x, z), "ball": math.inf}[body.shape]
        if across > IN_PLANE * math.hypot(x, y, z) or body.travel[1]:
            return f"the {body.shape} on {body.boundary!r} has no section, or moves out of it"
    for bc in scene.displacement_bcs:
        if bc.axis and math.hypot(bc.axis[0], bc.axis[2]) > IN_PLANE * math.hypot(*bc.axis):
            return f"the rotation of {bc.boundary!r} is not about y"
    given: list[tuple[str, tuple[Given, ...]]] = [
        *((f"the displacement of {bc.boundary!r}", bc.value) for bc in scene.displacement_bcs),
        *((f"the traction on {traction.boundary!r}", traction.value) for traction in scene.tractions),
        *((f"the pressure on {pressure.boundary!r}", (pressure.value, 0.0)) for pressure in scene.pressures),
    ]
    for name, parts in given:
        if any(isinstance(part, Formula) and "y" in part.variables for part in parts):
            return f"{name} varies along y"
        if isinstance(parts[1], Formula):
            return f"{name} has a component along y"
    # Formulas along x and z do not enter the comparison.
    vectors = [
        (name, tuple(0.0 if isinstance(part, Formula) else part for part in parts))
        for name, parts in given
        if len(parts) == 3
    ]
    if scene.gravity:
        vectors += [("gravity", each) for each in (scene.gravity.acceleration, scene.gravity.imaged) if each]
    asked = [quantity for quantity in scene.quantities if quantity.name != "strain"]
    vectors += [(f"the requested {quantity.label!r}", quantity.unit_vector) for quantity in asked]
    for name, vector in vectors:
        if abs(vector[1]) > IN_PLANE * math.hypot(*vector):
            return f"{name} has a component along y"
    for tissue in scene.tissues:
        if tissue.swelling:
            return f"the swelling of {tissue.region!r} is along y too"
        if tissue.fibre_map is not None:
            return f"the fibres of {tissue.region!r} are those of a map"
        if tissue.fibre_stiffness is not None and tissue.fibre is not None:
            x, y, z = tissue.fibre
            if min(abs(y), math.hypot(x, z)) > IN_PLANE * math.hypot(x, y, z):
                return f"the fibre of {tissue.region!r} is oblique to it"
    return None


def cannot_be_cut(scene: Scene) -> bool:
    """Whether a scene has no region of interest, or a condition or a quantity lies outside of it."""
    part = region_of_interest(scene.geometry)
    if part is None or scene.is_preloaded or scene.contacts:
        return True
    loads: list[Traction | Pressure] = [*scene.tractions, *scene.pressures]
    patterns = [bc.boundary for bc in scene.displacement_bcs] + [load.boundary for load in loads]
    uneven = [bc.boundary for bc in scene.displacement_bcs if not bc.is_even]
    uneven += [load.boundary for load in loads if any(isinstance(each, Formula) for each in _parts(load))]
    if any(re.fullmatch(pattern, side) for pattern in uneven for side in SHORTER):
        return True  # a condition on a whole side differs from one on a part of it
    patterns += [str(quantity.boundary) for quantity in scene.quantities if quantity.name == "force"]
    points = [quantity.point for quantity in scene.quantities if quantity.point]
    beyond = [point for point in points if any(abs(point[i]) > part.sides[i] / 2 for i in (0, 1))]
    return bool(beyond) or any(re.fullmatch(pattern, side) for pattern in patterns for side in CUT)


def _parts(load: Traction | Pressure) -> tuple[Given, ...]:
    return load.value if isinstance(load, Traction) else (load.value,)
