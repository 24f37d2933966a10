"""Options of the verbs; no module here imports anything that would delay `--help`.

- `cohort`: The verb `cohort`, and the options of other verbs that its list can contain.
- `common`: The parser, and the options of the other verbs.
- `help_page`: Parsers and the form of their help.
- `print_text`: Options that print a text, such as a template, and end the command.
- `simulate`: The verb `simulate`.
- `twin`: The verb `twin`.
- `types`: Argument types; each raises `argparse.ArgumentTypeError` for an invalid text.
"""

__all__ = ["cohort", "common", "help_page", "print_text", "simulate", "twin", "types"]
