"""The page of results on many tasks, written from the records of `throughput` and `memory`."""

from __future__ import annotations

from collections.abc import Iterable

from memory import ENOUGH, table
from throughput import HEADS, KINDS, WORKERS

WORK = {"two_frequencies": "zone, two frequencies, held out", "head": "retraction in MNI152, held out"}


def page(records: list[dict], memory: list[dict]) -> str:
    """Markdown: what falls short first."""
    empty, cohort = ([r for r in records if r["kind"] == kind] for kind in ("empty", "cohort"))
    kinds = [r for r in records if r["kind"] in KINDS]
    head = sum(r["cpu_s"] for r in kinds if r["kind"] in ("labels", "slice"))
    return "\n\n".join(
        [
            "# Many tasks on many workers",
            _made(records[0]["run"]),
            _short(kinds, memory),
            "![Overheads, gains and the cohort](../throughput.png)",
            "## Handing over a task that does nothing",
            _table(
                ("executor", "start (s)", "a task (ms)"),
                ((r["method"], f"{r['start_s']:.1f}", f"{1e3 * r['overhead_s']:.2f}") for r in empty),
            ),
            "The last is the peer, of the standard library. submitit without Slurm starts a process for every task, and its\n"
            "results are looked for every half second.",
            "## One worker and two",
            _table(
                ("work", "CPU seconds a task, one worker", "two workers", "tasks a second, two over one"),
                (
                    (KINDS[r["kind"]], f"{r['cpu_s']:.2f}", f"{r['cpu_two_s']:.2f}", f"{r['throughput_gain']:.2f}")
                    for r in kinds
                ),
            ),
            f"## {HEADS} heads on {WORKERS} workers, foretold",
            f"A head is one mesh of labels and one inversion in the plane as above, {head:.1f} s of CPU time, varied by a\n"
            "fifth from head to head. A worker that is free gets the next head; handing it over takes the time above.",
            _table(
                ("executor", "seconds", "workers busy"),
                ((r["method"], f"{r['wall_s']:.0f}", f"{r['busy']:.0%}") for r in cohort),
            ),
            "What the model leaves out: scans read from one file system at once, results of many MB, nodes of different\n"
            "speed, and memory bandwidth that the cores of a node share.",
            "## Memory, foretold",
            "![Memory against size](../memory.png)",
            _table(
                ("work", "counted in", "size", "peak (GiB)", "foretold from the other sizes", "off by"),
                (
                    (
                        WORK.get(r.get("work"), r["kind"]), r["of"], str(r["n"]),
                        f"{r['peak_gib']:.2f}", f"{r['foretold_gib']:.2f}", f"{r['error']:.0%}",
                    )
                    for r in memory
                ),
            ),
            _fits(memory),
        ]
    ) + "\n"  # fmt: skip


def _made(made: dict) -> str:
    return (
        f"Measured on one machine ({made['machine']}; commit {made['commit']}, {made['date']}) that did nothing else:\n"
        "[records](../throughput.json), [of memory](../memory.json). `throughput` writes this page from them, `memory` the table\n"
        "that the library foretells memory from."
    )


def _short(kinds: list[dict], memory: list[dict]) -> str:
    """What falls short, in sentences."""
    slow, *_, fast = sorted(kinds, key=lambda r: r["throughput_gain"])
    large = [r for r in memory if r["peak_gib"] >= 1]
    off = [r for r in large if r["error"] > ENOUGH]
    differ = [KINDS[r["kind"]] for r in kinds if not r["same_bits"]]
    sentences = [
        "**What falls short.** Nothing here ran on a cluster: Dask, MPI and submitit are local, two workers each, and the cohort",
        "below is computed by a model, not run.",
        f"In a second two workers did {slow['throughput_gain']:.2f} ({KINDS[slow['kind']]}) to {fast['throughput_gain']:.2f}",
        f"({KINDS[fast['kind']]}) times the tasks of one; CPU time a task on two workers was that of one within "
        f"{max(abs(r['cpu_two_s'] / r['cpu_s'] - 1) for r in kinds):.0%}.",
    ]
    if off:
        of = (f"{r['kind']}, {r['n']} {r['of']}: {r['peak_gib']:.2f} GiB, off by {r['error']:.0%}" for r in off)
        sentences.append(
            f"Of {len(large)} peaks of 1 GiB or more {len(off)} were not foretold within {ENOUGH:.0%} ({'; '.join(of)})."
        )
    else:
        most = max((r["error"] for r in large), default=0.0)
        sentences.append(
            f"All {len(large)} peaks of 1 GiB or more were foretold within {ENOUGH:.0%}, the worst off by {most:.0%}."
        )
    small = sorted({r["kind"] for r in memory} - {r["kind"] for r in large})
    if small:
        sentences.append(f"No peak of 1 GiB was measured for {', '.join(small)}: there the fit is beyond its sizes.")
    bits = f"differ in {', '.join(differ)}" if differ else "are the same to the last bit in every kind"
    return "\n".join([*sentences, f"Results of one worker and of two {bits}."])


def _fits(memory: list[dict]) -> str:
    fits = (
        f"{kind} {t['base_gib']:.2f} + {t['factor_gib']:.3g} n^{t['power']:.2f}" for kind, t in table(memory).items()
    )
    more = "; ".join(f"{kind} {t['each_frequency']:.2f}" for kind, t in table(memory).items() if "each_frequency" in t)
    return (
        f"Fitted (GiB): {'; '.join(fits)}.\nOf one frequency and one load; a zone in cubes of third order. "
        f"A frequency more adds this share of what is above the base:\n{more}."
    )


def _table(names: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    names = list(names)
    lines = [names, ["---"] * len(names), *map(list, rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
