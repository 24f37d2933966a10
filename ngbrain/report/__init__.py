"""Self-contained HTML reports of results, in pictures and tables, that open offline.

- `pages`: one HTML page for each kind of result.
- `pictures`: the figures of the pages.
- `render`: a small software renderer for surfaces.
- `words`: numbers, lengths and times as text.
"""

__all__ = ["pages", "pictures", "render"]
