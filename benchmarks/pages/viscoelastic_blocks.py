"""Tables of the page on viscoelastic blocks."""

from _pages import records
from _tables import Record, bullets, count, listing, name, number, percent, race, seconds, spread, verdict

STEPS = (3e-2, 1e-2, 3e-3, 1e-3)
SPACE = (5e-2, 2.5e-2, 1e-2, 8e-3)


def _of(study: str) -> list[Record]:
    return [r for r in records("retraction_time") if r["study"] == study]


def behind() -> str:
    return bullets(
        [
            f"Half an hour, steps. {verdict(_of('steps'), STEPS)}",
            f"Forty seconds, meshes. {verdict(_of('space'), SPACE)}",
        ]
    )


def halves() -> str:
    return race(_of("steps"), STEPS)


def fewer() -> str:
    found = [f"{number(r['fewer'], 3)} times as many as {count(r['n_steps'])}" for r in _of("steps") if r.get("fewer")]
    return f"Even steps that have the same error as steps by their error: {' and '.join(found)}."


def steps() -> str:
    columns = {
        "method": ("method", name), "steps": ("n_steps", count), "peak off by": ("peak_error", percent),
        "dose off by": ("dose_error", percent), "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    return listing(_of("steps"), columns)


def space_race() -> str:
    return race(_of("space"), SPACE)


def factors() -> str:
    """What keeping factors gains."""
    kept = {(r["order"], r["maxh"]): r["cpu_s"] for r in _of("space") if r["method"] == "ngbrain:exponential"}
    renewed = [r for r in _of("space") if r["method"].endswith("renewed")]
    gains = spread(r["cpu_s"] / kept[r["order"], r["maxh"]] for r in renewed)
    return f"Keeping factors gains {gains} times."


def space() -> str:
    columns = {
        "method": ("method", name), "order": ("order", str), "elements": ("maxh", lambda h: f"{number(1e3 * h)} mm"),
        "unknowns": ("ndof", count), "steps": ("n_steps", count), "dose off by": ("error", percent),
        "CPU time": ("cpu_s", seconds), "failed": ("reason", str),
    }  # fmt: skip
    return listing(_of("space"), columns)


def penalty() -> str:
    columns = {
        "contact": ("method", name), "penalty": ("penalty", lambda p: f"{number(p / 1e6)} MPa/m"),
        "steps": ("n_steps", count), "off by": ("error", percent), "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    return listing(_of("penalty"), columns)
