"""Tables of the page on retraction."""

from _pages import records
from _tables import Record, bullets, count, listing, number, percent, seconds, table

SHOWN = {
    "peak_pressure_mmHg": "peak pressure",
    "dose_mmHg_min": "dose",
    "peak_force_N": "force",
    "mps_p95": "strain near the site, 95 %",
    "von_mises_p95_kPa": "von Mises stress, 95 %",
}


def _runs() -> list[Record]:
    return [r for r in records("retraction_hour") if r["study"] == "run"]


def behind() -> str:
    first = next(r for r in records("quick_answers") if r.get("scene") == "demo_fast")
    whole = next(r for r in _runs() if r["protocol"] == "intermittent")
    worst = max((r for r in records("retraction_mesh") if r.get("errors") and r["error"]), key=lambda r: r["error"])
    return bullets([
        f"An hour with rests takes {number(whole['wall_s'] / 60, 3)} minutes on {whole['threads']} threads; {whole['rejected']} of"
        f" {whole['n_steps'] + whole['rejected']} steps were tried again.",
        f"`--quick` has its first answers of the fast demo's head after {seconds(first['wall_s'], 2)} on one thread,"
        " labels cached; asked are 60 s.",
        f"On the coarsest mesh of the {_head(worst)} ({number(worst['site_mm'])} mm at the site) the worst number is off by"
        f" {percent(worst['error'])}.",
    ])  # fmt: skip


def hour() -> str:
    columns = {
        "run": ("study", lambda s: {"run": "real head"}.get(s, "steps")), "protocol": ("protocol", str), "steps": ("steps", str),
        "unknowns": ("ndof", count), "threads": ("threads", str), "clock": ("wall_s", lambda s: seconds(s, 4)),
        "CPU time": ("cpu_s", lambda s: seconds(s, 4)), "steps taken": ("n_steps", count), "tried again": ("rejected", count),
        "Newton iterations": ("newton", count), "factorisations": ("factorisations", count),
        "peak": ("peak_mmHg", lambda p: f"{number(p, 4)} mmHg"), "dose": ("dose_mmHg_min", lambda d: f"{count(d)} mmHg min"),
        "peak off by": ("error_peak_mmHg", percent), "dose off by": ("error_dose_mmHg_min", percent),
        "inside the blade": ("inside", percent), "deepest": ("deepest", percent), "work out of balance": ("work_balance", percent),
    }  # fmt: skip
    return listing(records("retraction_hour"), columns)


def hour_conclusion() -> str:
    one, six = (next(r for r in _runs() if r["protocol"] == of) for of in ("continuous", "intermittent"))
    return (
        f"One hold of an hour takes {seconds(one['wall_s'], 3)} on the clock with {count(one['ndof'])} unknowns,"
        f" six holds of 490 s with five rests of 2 min {seconds(six['wall_s'], 4)}."
    )


def meshes() -> str:
    found = records("retraction_mesh")
    parts = []
    for head in dict.fromkeys(r["head"] for r in found):
        of = sorted((r for r in found if r["head"] == head), key=lambda r: -r["site_mm"])
        titles = [f"{number(r['site_mm'])} mm: {count(r['ndof'])} unknowns, {seconds(r['cpu_s'], 3)}" for r in of]
        rows = [[shown, *(_off(r, key) for r in of)] for key, shown in SHOWN.items() if key in of[0]["values"]]
        parts.append(
            f"**{_head(of[0])}**, off the finest mesh, whose own values stand in the last column:\n\n{table(('', *titles), rows)}"
        )
    return "\n\n".join(parts)


def _tested() -> list[Record]:
    return [r for r in records("quick_answers") if r["study"] == "test"]


def first_answers() -> str:
    rows = []
    for r in _tested():
        cells = [f"{r['seed']}: {r['tool']}, {r['protocol']}", f"{number(r['wall_mm'], 3)} mm"]
        for name, (_, coarse, refined) in r["answers"].items():
            low, high = (bound / coarse - 1 for bound in r["intervals"][name])
            off = _signed(refined / coarse - 1)
            cells.append(f"{off if r['inside'][name] else f'**{off}**'} ({_signed(low)}, {_signed(high)})")
        rows.append([*cells, f"{number(r['cpu_s'], 2)} of {number(r['cpu_s_refined'], 2)} s"])
    titles = [SHOWN[name] for name in _tested()[0]["answers"]]
    about = (
        "The refined answer off the coarse one; in brackets the interval; outside of it in bold."
        " CPU time of both coarse runs, and of the refined one."
    )
    return f"{about}\n\n{table(('scene', 'elements', *titles, 'CPU time'), rows)}"


def first_answers_conclusion() -> str:
    tested = _tested()
    single = [lies for r in tested for lies in r["inside"].values()]
    learnt = sum(r["study"] == "record" for r in records("quick_answers"))
    return (
        f"All main answers lie in their intervals in {sum(r['all_inside'] for r in tested)} of {len(tested)} scenes,"
        f" and {sum(single)} of {len(single)} answers do; the record has {learnt} scenes."
    )


def _signed(share: float) -> str:
    return f"{100 * share:+.0f} %"


def _off(record: Record, key: str) -> str:
    if not record.get("errors"):
        return number(record["values"][key], 3)
    said = record.get("estimates", {}).get(key)
    return percent(record["errors"][key]) + (f" ({percent(said)})" if said is not None else "")


def _head(record: Record) -> str:
    return {"mni152": "MNI152 head"}.get(record["head"], f"{record['head']} head")
