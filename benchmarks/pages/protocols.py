"""Tables of the page on retraction protocols."""

from _pages import records
from _tables import MISSING, Record, number, percent, spread, table

GROUPS = {"Griffiths' four": "griffiths", "Miller's two": "miller"}


def _values(group: str, **of: object) -> list[float]:
    return [
        r["value"] for r in records("protocols_compared")
        if r["constants"].startswith(GROUPS[group]) and all(r.get(key) == value for key, value in of.items())
        and isinstance(r["value"], float | int) and r["value"] == r["value"]
    ]  # fmt: skip


def _compared() -> list[Record]:
    return [r for r in records("protocols_compared") if r["kind"] == "protocol"]


def ranges() -> str:
    rows = []
    for comparison, measure in dict.fromkeys((r["comparison"], r["measure"]) for r in _compared()):
        cells = [_range(_values(group, kind="protocol", comparison=comparison, measure=measure)) for group in GROUPS]
        rows.append([comparison, measure, *cells])
    return table(("comparison", "measure", *GROUPS), rows)


def conclusion() -> str:
    def all_of(measure: str, comparison: str) -> str:
        return _range(
            [v for group in GROUPS for v in _values(group, kind="protocol", comparison=comparison, measure=measure)]
        )

    return (
        f"Rests lower later peaks ({all_of('mean of peaks', 'equal work')} in the mean, {all_of('last peak', 'equal work')} at the"
        f" last) and the dose of the first half hour ({all_of('dose of the first half hour', 'equal time')}); the first peak is the"
        f" same, and for equal work one hold has the lower dose, always ({all_of('dose', 'equal work')}). Stages lower the peak"
        f" ({all_of('peak', 'staged')})."
    )


def relaxation() -> str:
    found = [
        r for r in records("protocols_compared") if r["kind"] == "hold" and (r["strain"], r["rise_s"]) == (0.05, 10.0)
    ]
    rows = []
    for of in dict.fromkeys(r["constants"] for r in found):
        at = {r["measure"]: r["value"] for r in found if r["constants"] == of}
        half = at["half-time (min)"]
        rows.append([_named(of), f"{number(half, 3)} min" if half and half == half else MISSING, number(at["left"])])
    return table(("set", "half gone after", "left after half an hour"), rows)


def speeds() -> str:
    found = [r for r in records("protocols_compared") if r["kind"] == "rate"]
    all_speeds = sorted({r["mm_s"] for r in found})
    rows = [[group, *(_range(_values(group, kind="rate", mm_s=speed)) for speed in all_speeds)] for group in GROUPS]
    return table(("sets", *(f"{number(speed)} mm/s" for speed in all_speeds)), rows)


def block() -> str:
    found = [r for r in records("protocols_compared") if r["kind"] == "block"]
    of = found[0]
    alike = {"kind": "protocol", "constants": of["constants"], "strain": of["strain"], "pattern": of["pattern"]}
    columns = {
        r["measure"]: r["value"] for r in _compared()
        if all(r.get(key) == value for key, value in alike.items()) and r["comparison"] == "equal work"
    }  # fmt: skip
    rows = [[r["measure"], number(r["value"], 3), number(columns.get(r["measure"]), 3)] for r in found]
    about = f"{_named(of['constants'])}, opened by {percent(of['strain'])}, {of['pattern']}, bonded below, equal work."
    return f"{about}\n\n{table(('measure', 'block', 'column'), rows)}"


def _range(values: list[float]) -> str:
    return spread(values, lambda v: number(v, 3)) if values else MISSING


def _named(constants: str) -> str:
    return (
        constants.replace(":", ", ")
        .replace("_", " ")
        .replace("griffiths2024", "Griffiths 2024")
        .replace("miller", "Miller ")
    )
