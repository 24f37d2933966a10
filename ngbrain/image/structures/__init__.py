"""Structures of a brain: hemispheres, brain stem, dura, atlas regions.

- `atlas`: An atlas of one's own laid into a head: its template is registered, its labels follow.
- `dura`: Falx and tentorium, the sheets of dura between the parts of a brain, as open surfaces of triangles.
- `midsurface`: The surface between the two halves of a brain: a plane where the template has it, bent into the dark
  fissure.
- `structures`: Structures of a brain from its tissues: hemispheres, cerebellum, brain stem, deep grey matter and
  corpus callosum.
"""

__all__ = ["atlas", "dura", "midsurface", "structures"]
