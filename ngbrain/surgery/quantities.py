"""The numbers of a protocol's answer: what each describes, its unit, and how it scales with the tissue moduli."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.surgery.measures.dose_response import HELD_MINUTES
from ngbrain.surgery.measures.injury import dose
from ngbrain.surgery.measures.perfusion import LOW_MMHG
from ngbrain.surgery.measures.sampling import MeasureStatistics
from ngbrain.surgery.protocol_run import ProtocolResult
from ngbrain.units import to_kPa, to_mmHg

THRESHOLDS_MMHG = (20.0, 30.0)
"""Retraction pressures of Rosenorn & Diemer 1985: infarcts in 1 of 6, and in 5 of 6 rats, after 15 minutes."""


class Scaling(Enum):
    """How a number changes when all moduli are multiplied by one factor, for a prescribed tool motion."""

    UNCHANGED = "unchanged"
    MODULI = "proportional to the moduli"
    PRESSURE = "computed from the pressure over time"


@dataclass(frozen=True)
class ProtocolQuantity:
    """A number of a protocol's answer, or several parts of one.

    Parameters
    ----------
    key : str
        Key in `result.json`.
    name, unit : str
        Description and unit.
    scaling : Scaling
        How it scales with the tissue moduli.
    describes : bool
        Whether it describes the run rather than answers a question; such numbers have no error estimate.
    """

    key: str
    name: str
    unit: str = ""
    scaling: Scaling = Scaling.UNCHANGED
    describes: bool = False

    @property
    def label(self) -> str:
        """Name with the unit in brackets."""
        return f"{self.name} ({self.unit})" if self.unit else self.name


@dataclass(frozen=True)
class PressureQuantity(ProtocolQuantity):
    """A number that follows from the pressure (mmHg) over time.

    Parameters
    ----------
    key, name, unit, scaling, describes
        See `ProtocolQuantity`.
    of : callable, optional
        The number of a pressure curve; None for numbers that need the patient's data, see `perfusion` and `dose_response`.
    """

    scaling: Scaling = Scaling.PRESSURE
    of: Callable[[TimeCurve], float] | None = None


@dataclass(frozen=True)
class RunQuantity(ProtocolQuantity):
    """A number that is read off a run.

    Parameters
    ----------
    key, name, unit, scaling, describes
        See `ProtocolQuantity`.
    of : callable
        The number of a `ProtocolResult`.
    """

    of: Callable[[ProtocolResult], float | Mapping[str, float]] | None = None


def _above(threshold: float) -> list[PressureQuantity]:
    key, words = f"above_{threshold:.0f}_mmHg", f"above {threshold:.0f} mmHg"
    return [
        PressureQuantity(f"s_{key}", f"time {words}", "s", of=lambda curve: curve.above(threshold)[0]),
        PressureQuantity(
            f"longest_s_{key}", f"longest time {words} without a break", "s", of=lambda c: c.above(threshold)[1]
        ),
    ]


def _extreme(
    key: str,
    name: str,
    unit: str,
    column: str,
    to_unit: Callable[[float], float] = float,
    scaling: Scaling = Scaling.MODULI,
) -> RunQuantity:
    """The maximum of a column of a run's record."""
    return RunQuantity(key, name, unit, scaling, of=lambda run: float(to_unit(run.column(column).max())))


def _spread(
    key: str, name: str, unit: str, of: Callable[[ProtocolResult], MeasureStatistics], end: str = ""
) -> list[RunQuantity]:
    """Percentiles and the largest mean over `AMOUNT` (0.5 ml)."""
    parts: dict[str, tuple[str, Callable[[MeasureStatistics], float]]] = {
        "p50": (f"median of the {name}", lambda spread: spread.p50),
        "p95": (f"95th percentile of the {name}", lambda spread: spread.p95),
        "p99": (f"99th percentile of the {name}", lambda spread: spread.p99),
        "max_over_0_5_ml": (f"largest mean of the {name} over 0.5 ml", lambda spread: spread.largest),
    }
    stress = unit == "kPa"
    scaling, to_unit = (Scaling.MODULI, to_kPa) if stress else (Scaling.UNCHANGED, float)

    def quantity(part: str, words: str, value: Callable[[MeasureStatistics], float]) -> RunQuantity:
        return RunQuantity(f"{key}_{part}{end}", words, unit, scaling, of=lambda run: to_unit(value(of(run))))

    return [quantity(part, *each) for part, each in parts.items()]


def _time_of_maximum(key: str, of_what: str, of: Callable[[ProtocolResult], float]) -> RunQuantity:
    return RunQuantity(key, f"when the {of_what} is largest", "s", describes=True, of=of)


QUANTITIES: Mapping[str, ProtocolQuantity] = {
    each.key: each
    for each in (
        PressureQuantity("peak_pressure_mmHg", "peak pressure under the blade", "mmHg", of=lambda curve: curve.peak),
        PressureQuantity("dose_mmHg_min", "pressure dose", "mmHg min", of=dose),
        *(each for threshold in THRESHOLDS_MMHG for each in _above(threshold)),
        PressureQuantity(
            "margin_to_20_mmHg", "margin to 20 mmHg", "mmHg", of=lambda curve: THRESHOLDS_MMHG[0] - curve.peak
        ),
        PressureQuantity(f"s_perfusion_below_{LOW_MMHG:.0f}_mmHg", "time with little perfusion", "s"),
        PressureQuantity(f"longest_s_perfusion_below_{LOW_MMHG:.0f}_mmHg", "longest time with little perfusion", "s"),
        PressureQuantity("min_perfusion_reserve_mmHg", "smallest perfusion reserve", "mmHg"),
        PressureQuantity(f"pressure_held_{HELD_MINUTES:.0f}_min_mmHg", "pressure sustained for 15 minutes", "mmHg"),
        PressureQuantity("pressed_min", "loading time", "min", describes=True),
        PressureQuantity(
            "infarct_probability_95_at_held", "interval of the infarct probability at the sustained pressure"
        ),
        PressureQuantity("infarct_probability_95", "interval of the infarct probability"),
        _extreme("peak_tip_pressure_mmHg", "peak pressure at the tip", "mmHg", "tip_pressure", to_mmHg),
        _extreme("peak_centre_pressure_mmHg", "peak pressure in the middle", "mmHg", "centre_pressure", to_mmHg),
        _extreme("peak_force_N", "peak force of the blade", "N", "force"),
        _extreme(
            "largest_contact_area_mm2",
            "largest contact area",
            "mm²",
            "area",
            lambda area: 1e6 * area,
            Scaling.UNCHANGED,
        ),
        RunQuantity(
            "min_net_reaction_N",
            "smallest net reaction of the tissue",
            "N",
            Scaling.MODULI,
            of=lambda run: float(run.column("net_reaction").min()),
        ),
        *_spread("mps", "maximum principal strain", "", lambda run: run.peak.mps),
        *_spread("oss", "octahedral shear strain", "", lambda run: run.peak.oss),
        _time_of_maximum("strain_peak_at_s", "strain", lambda run: run.peak.t),
        *_spread("von_mises", "von Mises stress", "kPa", lambda run: run.largest["von_mises"], "_kPa"),
        _time_of_maximum("von_mises_peak_at_s", "von Mises stress", lambda run: run.largest["von_mises"].t),
        *_spread("strain_rate", "strain rate", "1/s", lambda run: run.largest["rate"], "_per_s"),
        _time_of_maximum("strain_rate_peak_at_s", "strain rate", lambda run: run.largest["rate"].t),
        RunQuantity(
            "volume_mps_above",
            "volume of tissue strained beyond",
            "ml",
            of=lambda run: {above: sum(parts.values()) for above, parts in run.peak.volume_mps_above.items()},
        ),
        ProtocolQuantity("volume_mps_above_by_region_ml", "volume of each tissue strained beyond", "ml"),
        RunQuantity(
            "beyond_fit_ml",
            "volume strained beyond what its law was fitted to",
            "ml",
            of=lambda run: sum(run.peak.beyond_fit.values()),
        ),
        RunQuantity("beyond_fit_by_region_ml", "the same of each tissue", "ml", of=lambda run: run.peak.beyond_fit),
        RunQuantity(
            "compressed_by_35_percent_ml",
            "volume compressed by 35 %",
            "ml",
            of=lambda run: sum(run.peak.creased.values()),
        ),
        RunQuantity("region_ml", "volume of each tissue", "ml", describes=True, of=lambda run: run.peak.tissue),
        RunQuantity("volumes_ml", "displaced volume", "ml", of=lambda run: run.peak.volume),
        RunQuantity("min_det_F", "smallest det F", describes=True, of=lambda run: float(run.column("min_det_F").min())),
        RunQuantity("working_s", "time at full opening", "s", describes=True, of=lambda run: run.working_s),
    )
}
"""All quantities, by their key in `result.json`."""


def pressure_quantities(curve: TimeCurve) -> dict[str, float]:
    """All numbers that follow from the pressure (mmHg) over time alone."""
    found = (each for each in QUANTITIES.values() if isinstance(each, PressureQuantity))
    return {each.key: float(each.of(curve)) for each in found if each.of is not None}


def run_quantities(run: ProtocolResult) -> dict[str, float | Mapping[str, float]]:
    """All numbers that are read off a run."""
    found = (each for each in QUANTITIES.values() if isinstance(each, RunQuantity))
    return {each.key: each.of(run) for each in found if each.of is not None}
