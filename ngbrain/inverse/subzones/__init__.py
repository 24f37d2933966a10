"""Subzone inversion: wave data in space, inverted by overlapping subzones.

- `consensus`: the inversion of a zone with prior information from its neighbours.
- `global_check`: the misfit of joined maps in one wave problem of the whole body.
- `invert`: the inversion zone by zone, in parallel, with consensus passes.
- `merge`: joined maps and waves, shared regularisation weights, disagreement of zones, and the final `Inversion`.
- `partition`: overlapping boxes of lattice cells, and weighted means of their maps.
- `roughness`: ∫ |∇m|² of a map that is given at points.
- `zone_result`: the result of a zone, and its checkpoint file.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse.subzones import consensus, global_check, invert, merge, partition, roughness, zone_result
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["consensus", "global_check", "invert", "merge", "partition", "roughness", "zone_result"]
