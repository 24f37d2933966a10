"""How keys stand in a TOML file: units, limits, formulas, patterns.

- `document`: How a field stands in TOML: under which key, in which unit, and what is accepted.
- `formulas`: Formulas in a file: arithmetic of named variables, read into a tree of known parts; nothing in them is
  executed.
- `patterns`: How long a regular expression may take: those that try too many ways to match a name are found before
  one is matched.
"""

__all__ = ["document", "formulas", "patterns"]
