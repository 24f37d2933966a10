"""Fields of TOML files: keys, units, limits, formulas and name patterns.

- documents: `Document` of `Section`s, an `Entry` for each field; `entries` of a section, `read_toml`, `to_toml`
- fields of a section: `number`, `integer`, `formula`, `text`, `choice`, `choice_or_table`, `pattern`, `path`, `table`
- formulas and patterns: `Formula`, `is_pattern`

Modules
-------
- `document`: TOML documents of checked sections: keys, units, conversion to SI, reading and writing.
- `fields`: Fields of a section: numbers, formulas, text, choices, paths, tables.
- `formulas`: Arithmetic formulas of named variables, parsed into a syntax tree; no code is executed.
- `patterns`: Check that a regular expression is quick to match.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.schema import document, fields, formulas, patterns
    from ngbrain.schema.document import Document, Entry, Section, entries, read_toml, to_toml
    from ngbrain.schema.fields import choice, choice_or_table, formula, integer, number, path, pattern, table, text
    from ngbrain.schema.formulas import Formula
    from ngbrain.schema.patterns import is_pattern
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "Document",
    "Entry",
    "Formula",
    "Section",
    "choice",
    "choice_or_table",
    "document",
    "entries",
    "fields",
    "formula",
    "formulas",
    "integer",
    "is_pattern",
    "number",
    "path",
    "pattern",
    "patterns",
    "read_toml",
    "table",
    "text",
    "to_toml",
]
