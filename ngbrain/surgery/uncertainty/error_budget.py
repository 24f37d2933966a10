"""Error budget of a retraction: balances of its runs, discretisation errors, and the spread due to the material."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.scene import Patient, Scene
from ngbrain.surgery.answers import Answer, Runs, pressure_answers, pressure_series, scale_moduli
from ngbrain.surgery.protocol_run import ProtocolResult
from ngbrain.surgery.quantities import QUANTITIES, ProtocolQuantity
from ngbrain.surgery.uncertainty.verification_runs import HALF, MESH, MILLER, ORDER
from ngbrain.units import to_mm

APART = 1e-9
"""Gap (m) above which a blade counts as separated: elastic tissue follows it and touches it up to round-off."""
COMPUTED, FAILED, UNDER_WAY, NOT_COMPUTED = "computed", "failed", "under way", "not computed"
"""Status of a verification run; "not computed" is one that was left out on request."""

Errors = dict[str, dict[str, Any]]
"""Name of a number → its entry, see `errors`."""


def hold_answer(scene: Scene, found: Mapping[str, Answer], checked: Mapping[str, Any]) -> Answer | None:
    """The answer of one opening held to the end.

    Parameters
    ----------
    scene : Scene
    found : mapping of dict
        Answers by protocol.
    checked : mapping
        Results of the verification runs by name.

    Returns
    -------
    dict or None
        That of a continuous protocol, or of the verification run; None if it failed.
    """
    named = [asked.name for asked in scene.protocols if asked.kind == "continuous"]
    if named:
        return found[named[0]]
    return checked[MESH] and checked[MESH][0]


def errors(own: Answer | None, checked: Mapping[str, Any], factors: Iterable[float], patient: Patient) -> Errors:
    """Error budget of the numbers of a hold.

    Each entry has the value, its change by each verification run, and its range over published materials, in its own unit:

    - mesh: change on other elements everywhere, see `verification_runs.OTHER`
    - order: change with elements one order higher near the cleft, elastic, on a coarse mesh; numbers that follow from the pressure
      over time change as if all pressures changed by the relative change of the peak
    - step: change with half the time step, on a coarse mesh
    - numerics: the sum of those that are known
    - material: the lowest and highest value with Miller's exponent and with moduli multiplied by `factors`

    Parameters
    ----------
    own : dict, optional
        The answer of a hold; None gives an empty result.
    checked : mapping
        Results of the verification runs by name.
    factors : iterable of float
        Published moduli relative to the scene's.
    patient : Patient

    Returns
    -------
    dict
        Name of a number → entry; parts are named NAME/PART. A change is None where its run failed or is not computed.
    """
    if own is None:
        return {}
    own_numbers = _known(own)
    moves = {
        "mesh": _differences(_pair(checked[MESH], own)),
        "order": _differences(checked[ORDER]) | _order_of_pressure(own, checked[ORDER], patient),
        "step": _differences(_pair(checked[HALF], own)),
    }
    others = [_numbers(scale_moduli(own, factor, patient)) for factor in factors]
    others += [_numbers(checked[MILLER])] if checked[MILLER] else []
    result: Errors = {}
    for name, number in own_numbers.items():
        value = number.value
        by = {kind: moved.get(name) for kind, moved in moves.items()}
        known = [moved for moved in by.values() if moved is not None]
        all_of_it = [value, *(other[name] for other in others if name in other)]
        result[name] = {
            "value": value,
            "unit": number.of.unit,
            "quantity": number.of.key,
            "part": number.part,
            **by,
            "numerics": sum(known) if known else None,
            "material": [min(all_of_it), max(all_of_it)],
        }
    return result


@dataclass(frozen=True)
class _Number:
    """A number of an answer: its quantity and part ("" for the whole)."""

    of: ProtocolQuantity
    part: str
    value: float


def _numbers(found: Answer) -> dict[str, float]:
    """The numbers of an answer that are known quantities and do not describe the run; parts as NAME/PART."""
    return {name: number.value for name, number in _known(found).items()}


def _known(found: Answer) -> dict[str, _Number]:
    known = [each for each in QUANTITIES.values() if each.key in found and not each.describes]
    numbers = [_Number(each, part, value) for each in known for part, value in _parts(found[each.key])]
    return {"/".join(filter(None, (number.of.key, number.part))): number for number in numbers}


def _parts(value: Any, part: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for name, each in value.items():
            yield from _parts(each, f"{part}/{name}" if part else name)
    elif isinstance(value, int | float):
        yield part, float(value)


def _pair(pair: tuple[Answer | None, Answer] | None, own: Answer) -> tuple[Answer, Answer] | None:
    """A pair with the scene's own hold where a run has no other reference."""
    return pair and (pair[0] or own, pair[1])


def _differences(pair: tuple[Answer, Answer] | None) -> dict[str, float]:
    """Differences between the numbers of two answers."""
    if not pair:
        return {}
    first, second = map(_numbers, pair)
    return {name: abs(second[name] - value) for name, value in first.items() if name in second}


def _order_of_pressure(own: Answer, pair: tuple[Answer, Answer] | None, patient: Patient) -> dict[str, float]:
    if not pair:
        return {}
    low, high = (each["peak_pressure_mmHg"] for each in pair)
    names = _numbers(pressure_answers(*pressure_series(own), patient))
    moved = _differences((own, scale_moduli(own, high / low, patient)))
    return {name: moved[name] for name in names}


def _relative(of: Mapping[str, Any], kind: str) -> float | None:
    moved = of.get(kind)
    return None if moved is None else moved / of["value"]


def checks(scene: Scene, runs: Runs, errors: Errors) -> dict[str, float | None]:
    """Balances and checks of the runs, the worst of all protocols; errors are relative here.

    Parameters
    ----------
    scene : Scene
    runs : dict of ProtocolResult
    errors : dict
        The error budget, see `errors`.

    Returns
    -------
    dict
        Name → value, None where it is not known; the report states what each should be.
    """
    energy, volume, off_force, off_gap, recontact = [], [], [], [], []
    for run in runs.values():
        kept = sum(run.column(name) for name in ("contact_energy", "tissue_work", "friction_work"))
        gone = run.column("blade_work") - kept
        energy.append(abs(gone[-1]) / run.column("tissue_work_size")[-1])
        parts = np.array(list(run.peak.volume.values()))
        volume.append(abs(parts.sum()) / np.abs(parts).max())
        away = run.column("gap") > APART
        away[0] = False  # the start, in touch without force
        off_force.append(float(np.abs(run.column("force")[away]).max(initial=0.0)))
        if away.any():
            off_gap.append(float(run.column("gap")[away].min()))
            recontact.append(_recovered(run, away))
    ramp = scene.time.ramp
    firsts = [float(run.column("pressure")[run.column("t") <= ramp].max()) for run in _full_ramps(scene, runs)]
    peak = firsts[0] if firsts else float("nan")
    of_peak = errors.get("peak_pressure_mmHg", {})
    return {
        "reaction_balance": max(_imbalance(run) for run in runs.values()),
        "volume_balance": float(max(volume)),
        "energy_balance": float(max(energy)),
        "dt_halving": _relative(of_peak, "step"),
        "order_plus_one": _relative(of_peak, "order"),
        "other_elements": _relative(of_peak, "mesh"),
        "min_net_reaction_N": min(float(run.column("net_reaction").min()) for run in runs.values()),
        "force_while_off_N": max(off_force),
        "gap_while_off_mm": to_mm(min(off_gap)) if off_gap else None,
        "tissue_in_blade": max(float(run.column("depth").max()) for run in runs.values()) / scene.tool.travel,
        "deepest_in_blade": max(float(-run.column("gap").min()) for run in runs.values()) / scene.tool.travel,
        "first_peaks_differ": (max(firsts) - min(firsts)) / peak if len(firsts) > 1 else None,
        "recontact_opening_below_release_mm": to_mm(min(recontact)) if recontact else None,
    }


def _imbalance(run: ProtocolResult) -> float:
    """Largest |blade + supports| over the largest blade force."""
    force = run.column("force")
    return float((run.column("balance") * force).max() / force.max())


def _full_ramps(scene: Scene, runs: Runs) -> list[ProtocolResult]:
    """Runs that reach the full opening in one ramp."""
    kinds = {p.name: p.kind for p in scene.protocols}
    return [run for name, run in runs.items() if kinds[name] in ("continuous", "intermittent")]


def _recovered(run: ProtocolResult, away: np.ndarray) -> float:
    """Smallest decrease (m) of the opening from the start of a release to the next contact."""
    opening, advance = run.column("opening"), run.column("advance")
    recovered = []
    for i in np.flatnonzero(away[:-1] & ~away[1:]):
        held = np.flatnonzero(advance[:i] >= advance[:i].max(initial=0.0) * (1 - 1e-9))  # a later one may go further
        if held.size:
            recovered.append(opening[held[-1]] - opening[i])
    return min(recovered, default=float("nan"))
