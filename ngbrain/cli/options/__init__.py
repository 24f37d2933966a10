"""Options of the verbs; nothing is imported here that `--help` would wait for.

- `cohort`: What the verb `cohort` can be given, and which options of other verbs the columns of its list can give.
- `common`: What every verb of the command line can be given. Nothing is imported here that a `--help` would wait for.
- `simulate`: What the verb `simulate` can be given. Nothing is imported here that a `--help` would wait for.
- `types`: What arguments are read as: each raises `argparse.ArgumentTypeError` for what it is not.
"""

__all__ = ["cohort", "common", "simulate", "types"]
