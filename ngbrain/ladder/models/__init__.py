"""What a model is of a scene: geometry, materials, motions, contacts, waves.

- `bodies`: The problems of a scene's models: materials, supports, loads, elements.
- `contacts`: Rigid bodies of a scene as contacts of a problem: signed distance, motion, friction.
- `geometry`: Meshes of a `Geometry` in several sizes, in space and of the plane y = 0 through its site.
- `gravity`: Gravity and the fluid around a body, as loads of a problem.
- `hierarchy`: A scene's models of every level, and their solutions.
- `laws`: Constitutive laws and elements of a model's levels.
- `motions`: Prescribed displacements and loads over time: formulas, rotations, proportional loads.
- `property_maps`: Measured maps of stiffness and fibre directions, as fields over a body.
- `section`: Whether a plane section or a region of interest can represent a scene.
- `waves`: The harmonic problem of a scene, and the requested amplitudes.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.ladder.models import (
        bodies,
        contacts,
        geometry,
        gravity,
        hierarchy,
        laws,
        motions,
        property_maps,
        section,
        waves,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "bodies",
    "contacts",
    "geometry",
    "gravity",
    "hierarchy",
    "laws",
    "motions",
    "property_maps",
    "section",
    "waves",
]
