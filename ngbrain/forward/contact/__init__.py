"""Contact with rigid bodies.

`rigid` (contact by a signed distance function, sliding walls, self-contact), Coulomb `friction`, prescribed `motion` of rigid
bodies, numerical `parameters`, and `force_control` (prescribed force, unknown travel).
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward.contact import force_control, friction, motion, parameters, rigid
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["force_control", "friction", "motion", "parameters", "rigid"]
