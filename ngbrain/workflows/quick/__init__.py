"""First answers of a scene within a minute or two, before it is computed as described.

- `operation`: An operation on two coarse meshes first, with intervals from a record of other scenes.
- `search`: A body under loads, with the bounds of the model search as intervals.
- `first_answers`: First answers compared with the refined ones.
"""

__all__ = ["first_answers", "operation", "search"]
