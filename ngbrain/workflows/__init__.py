"""Whole jobs, from files to files, that the command line and Python share.

cohort     many scans or cases through one of the command's verbs: one table and one report
listing    the list of a cohort, looked at before the work begins
rows       a row of it, computed by its verb in a folder of its own
summary    the main numbers of a verb's result
results    the rows with their verdicts, their statistics, the table
gate       numbers that stand out from those of the other rows
"""

__all__ = ["cohort", "gate", "listing", "results", "rows", "summary"]
