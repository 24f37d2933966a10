"""Pages that open alone, offline: what a run found, in pictures and tables.

- `pages`: one HTML page for each kind of result.
- `pictures`: what they show.
- `render`: a small software renderer.
"""

__all__ = ["pages", "pictures", "render"]
