"""The answers of a retraction from its runs, in clinical units: the contents of `result.json`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.scene import Patient
from ngbrain.surgery.head_models import FIBRES
from ngbrain.surgery.measures.dose_response import infarct_probability
from ngbrain.surgery.measures.injury import dose
from ngbrain.surgery.measures.perfusion import perfusion
from ngbrain.surgery.model import TISSUE, RetractionModel
from ngbrain.surgery.protocol_run import ProtocolResult
from ngbrain.surgery.protocols import ForceProtocol, ToolMotion
from ngbrain.surgery.quantities import QUANTITIES, Scaling, pressure_quantities, run_quantities
from ngbrain.units import to_ml, to_mm, to_mmHg

Runs = dict[str, ProtocolResult]
Answer = dict[str, Any]
"""Numbers and time series of one protocol, by name (`answer`)."""

DENSITY = 1040.0
"""Approximate density of brain (kg/m³), for the shear-wave speed."""
SLOW = 10.0
"""Inertia is reported as relevant if the blade's motion takes less than this many shear-wave transit times."""
SAME = 1e-6
"""Relative difference up to which two openings count as equal."""

LEFT_OUT = (
    "friction between blade and tissue",
    "blood flow and drainage of tissue fluid; ventricles are a soft drained filling",
    "damage: tissue recovers from any strain",
)


def answer(run: ProtocolResult, patient: Patient) -> Answer:
    """Numbers and time series of one protocol.

    Parameters
    ----------
    run : ProtocolResult
    patient : Patient

    Returns
    -------
    dict
        By the keys of `result.json`; lengths in mm, pressures in mmHg, forces in N.
    """
    t, pressure = run.column("t"), to_mmHg(run.column("pressure"))
    return {
        **pressure_answers(t, pressure, run.events, patient),
        **run_quantities(run),
        "volume_mps_above_by_region_ml": _by_region(run.peak.volume_mps_above),
        "events_s": list(run.events),
        "series": {
            "t_s": t.tolist(),
            "opening_mm": to_mm(run.column("opening")).tolist(),
            "blade_mm": to_mm(run.column("advance")).tolist(),
            "force_N": run.column("force").tolist(),
            "contact_area_mm2": (1e6 * run.column("area")).tolist(),
            "pressure_mmHg": pressure.tolist(),
            "tip_pressure_mmHg": to_mmHg(run.column("tip_pressure")).tolist(),
            "centre_pressure_mmHg": to_mmHg(run.column("centre_pressure")).tolist(),
            "min_gap_mm": to_mm(run.column("gap")).tolist(),
        },
    }


def pressure_answers(t: np.ndarray, pressure: np.ndarray, events: Sequence[float], patient: Patient) -> Answer:
    """Numbers that follow from the pressure over time alone.

    Parameters
    ----------
    t : (n,) array
        Times (s).
    pressure : (n,) array
        Pressure (mmHg).
    events : sequence of float
        Times (s) at which the tool's rate changes, as in `TimeCurve`.
    patient : Patient

    Returns
    -------
    dict
        Pressure doses, perfusion and infarct probability.
    """
    over_time = TimeCurve(t, pressure, events)
    return {**pressure_quantities(over_time), **perfusion(patient, over_time), **infarct_probability(over_time)}


def scale_moduli(found: Answer, factor: float, patient: Patient) -> Answer:
    """The answer with all pressures, forces and stresses multiplied by one factor.

    This is the exact effect of multiplying all moduli by that factor, for a prescribed tool motion without inertia, if their ratios
    (bulk to shear, branch to branch, contact to tissue) and the relaxation times stay the same; strain does not change.

    Parameters
    ----------
    found : dict
        An `answer`.
    factor : float
    patient : Patient

    Returns
    -------
    dict
        The scaled answer.
    """
    t, pressure, events = pressure_series(found)
    loads = {
        each.key: factor * found[each.key]
        for each in QUANTITIES.values()
        if each.scaling is Scaling.MODULI and each.key in found
    }
    return found | loads | pressure_answers(t, factor * pressure, events, patient)


def pressure_series(found: Answer) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Times (s), pressures (mmHg) and events (s) of an answer, the arguments of `pressure_answers`."""
    series = found["series"]
    return np.array(series["t_s"]), np.array(series["pressure_mmHg"]), found["events_s"]


def _by_region(volumes: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """Threshold → region → ml, transposed to region → threshold → ml."""
    regions = next(iter(volumes.values()))
    return {region: {threshold: parts[region] for threshold, parts in volumes.items()} for region in regions}


def model_limitations(made: RetractionModel, runs: Runs) -> list[str]:
    """What the model leaves out, in words.

    Parameters
    ----------
    made : RetractionModel
    runs : dict of ProtocolResult
        By protocol; the motion of force-controlled blades is taken from them.

    Returns
    -------
    list of str
    """
    rubs = made.scene.tool.friction > 0
    said = [text for text in LEFT_OUT if not (rubs and "friction" in text)]
    has_fibres = any(tissue.fibre_stiffness for tissue in made.scene.tissues)
    of_head = made.head.left_out.replace(FIBRES, "") if has_fibres else made.head.left_out
    return [_inertia(made, runs), *said, of_head]


def _inertia(made: RetractionModel, runs: Runs) -> str:
    """Duration of the fastest blade motion compared with a shear wave through the softest tissue."""
    programs = [made.program(made.scene, asked) for asked in made.scene.protocols]
    went = [
        (runs[p.name].column("t"), runs[p.name].column("advance")) for p in programs if isinstance(p, ForceProtocol)
    ]
    went += [(np.array(p.times), np.array(p.advance)) for p in programs if isinstance(p, ToolMotion)]
    speed = max(float(np.abs(np.diff(advance) / np.diff(t)).max()) for t, advance in went)
    way = float(max(advance.max() for _, advance in went))
    wave = np.sqrt(min(part.modulus for part in made.parts().values()) / DENSITY)
    brain = float(np.ptp(np.array(made.mesh.ngmesh.Coordinates()) @ made.cleft.across))
    ratio = way / speed / (brain / wave)
    times = f"{ratio:.0f} times" if ratio >= SLOW else f"only {ratio:.2g} times"
    text = (
        f"the blade moves at up to {to_mm(speed):.3g} mm/s, at which its {to_mm(way):.3g} mm take {way / speed:.3g} s, {times} "
        f"as long as a shear wave through the brain ({to_mm(brain):.0f} mm at {wave:.2g} m/s: {brain / wave:.2g} s)"
    )
    if ratio >= SLOW:
        return f"inertia: {text}"
    return f"inertia, which matters here: {text}; pressures are quasi-static (a `Problem` with `Inertia` has mass)"


def model_summary(made: RetractionModel, runs: Runs) -> dict[str, Any]:
    """Size of the model and computational work.

    Parameters
    ----------
    made : RetractionModel
    runs : dict of ProtocolResult

    Returns
    -------
    dict
        Numbers of elements and unknowns, volumes (ml), time steps and solver counts.
    """
    import ngsolve as ngs

    def volume(pattern: str) -> float:
        return to_ml(ngs.Integrate(ngs.CF(1), made.mesh, definedon=made.mesh.Materials(pattern)))

    n_u = 3 * (made.mesh.nv + made.mesh.nedge) + made.mesh.nv
    return {
        "n_tets": made.mesh.ne,
        "n_unknowns": n_u,
        "brain_ml": volume(TISSUE),
        "ventricles_ml": volume("ventricle.*"),
        "n_steps": sum(run.steps for run in runs.values()),
        "rejected": sum(run.rejected for run in runs.values()),
        "newton": sum(run.newton for run in runs.values()),
        "factorisations": sum(run.factorisations for run in runs.values()),
    }


def comparison(runs: Runs, numbers: dict[str, Answer]) -> dict[str, Any]:
    """Compare protocols: the lowest one for each measure, and continuous with intermittent retraction at equal working time.

    Parameters
    ----------
    runs : dict of ProtocolResult
    numbers : dict of dict
        The `answer` of each protocol.

    Returns
    -------
    dict
        Findings in words and the doses at equal working time; empty for a single protocol.
    """
    if len(runs) < 2:
        return {}
    findings, ways = [], {name: float(to_mm(run.column("advance").max())) for name, run in runs.items()}
    if max(ways.values()) - min(ways.values()) > SAME * max(ways.values()):
        findings.append("Openings differ: travel of the blade (mm) " + _listed(ways) + ".")
    for metric, text in (
        ("peak_pressure_mmHg", "Peak pressure (mmHg)"),
        ("peak_tip_pressure_mmHg", "Peak pressure at the tip (mmHg)"),
        ("dose_mmHg_min", "Pressure-time dose over the whole time (mmHg min)"),
        ("longest_s_above_20_mmHg", "Longest time above 20 mmHg without a break (s)"),
        ("longest_s_above_30_mmHg", "Longest time above 30 mmHg without a break (s)"),
        ("mps_p95", "95th percentile of maximum principal strain near the site"),
    ):
        values = {name: number[metric] for name, number in numbers.items()}
        findings.append(f"{text}: " + _ranked(values))
    result: dict[str, Any] = {"findings": findings}
    alike = [ways[name] for name in ("continuous", "intermittent") if name in ways]
    if len(alike) == 2 and abs(alike[0] - alike[1]) <= SAME * max(alike):
        working = runs["intermittent"].working_s
        continuous = runs["continuous"]
        t, pressure = continuous.column("t"), to_mmHg(continuous.column("pressure"))
        until = t[-1] - (continuous.working_s - working)  # it works from the end of its ramp on
        equal = {
            "working_s": working,
            "continuous": dose(TimeCurve(t, pressure, continuous.events), until),
            "intermittent": numbers["intermittent"]["dose_mmHg_min"],
        }
        result["dose_at_equal_working_time_mmHg_min"] = equal
        higher = "higher" if equal["intermittent"] > equal["continuous"] else "lower"
        findings.append(
            f"At equal working time ({working:.0f} s at full opening) the dose of intermittent retraction is {higher}: "
            f"{equal['intermittent']:.1f} against {equal['continuous']:.1f} mmHg min."
        )
    return result


def _listed(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in sorted(values.items(), key=lambda item: item[1]))


def _ranked(values: dict[str, float]) -> str:
    spread = max(values.values()) - min(values.values())
    listed = _listed(values)
    if spread <= 5e-3 * abs(max(values.values())):
        return f"equal within 0.5 % ({listed})."
    return f"lowest with {min(values, key=values.__getitem__)} ({listed})."
