"""Fields of TOML files: keys, units, limits, formulas and name patterns.

- `document`: TOML documents of checked sections: keys, units, conversion to SI, reading and writing.
- `fields`: Fields of a section: numbers, formulas, text, choices, paths, tables.
- `formulas`: Arithmetic formulas of named variables, parsed into a syntax tree; no code is executed.
- `patterns`: Check that a regular expression is quick to match.
"""

__all__ = ["document", "fields", "formulas", "patterns"]
