"""What the answer of a twin is worth: thresholds, assumptions, the conclusion in words, and the evidence behind each part.

The categories are those of ASME V&V 40 and of the FDA's guidance on the credibility of computational modelling; a category without
evidence is in the table, and says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ngbrain.surgery.measures import dose_response
from ngbrain.surgery.measures.injury import MPS_THRESHOLDS
from ngbrain.surgery.quantities import QUANTITIES
from ngbrain.surgery.twin.case import Case
from ngbrain.surgery.twin.comparison import OPEN, Difference
from ngbrain.surgery.twin.prior import Prior
from ngbrain.surgery.twin.response import PRESSURE, STRAIN
from ngbrain.surgery.twin.stiffness import RelativeStiffness

QUESTION = (
    "Which of the stated plans presses and strains this patient's tissue less, and is the difference larger than what is not "
    "known?"
)
CONTEXT = (
    "research: plans are compared with one another for one patient; no probability of injury, no single score, no clinical "
    "decision"
)


def conclusion(differences: Sequence[Difference], second: Mapping[str, Any] | None = None) -> list[str]:
    """The decisions in words, a sentence for each pair of plans, and one where the second way from waves ranks plans otherwise.

    Parameters
    ----------
    differences : sequence of Difference
    second : mapping, optional
        As of `spectrum.rank_by_spectrum`.

    Returns
    -------
    list of str
    """
    found = list[str]()
    pairs = dict.fromkeys((each.first, each.second) for each in differences)
    for first, other in pairs:
        mine = [each for each in differences if (each.first, each.second) == (first, other)]
        by: dict[str, list[str]] = {}
        for each in mine:
            by.setdefault(each.decision, []).append(QUANTITIES[each.measure].name)
        parts = [f"{plan} is lower in {_listed(names)}" for plan, names in by.items() if plan != OPEN]
        if OPEN in by:
            parts.append(f"open is {_listed(by[OPEN])}: what is not known is larger than the difference")
        found.append(f"{first} and {other}: {'; '.join(parts)}.")
    for each in (second or {}).get("ranked_differently", ()):
        words = QUANTITIES[each["measure"]].name
        found.append(
            f"{each['first']} and {each['second']} rank differently in {words} where the level of the stiffness is taken from the "
            "waves' spectrum: the choice depends on that."
        )
    return found


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def thresholds() -> list[dict[str, Any]]:
    """Published thresholds that the measures stand beside, with species and number of animals."""
    found = [
        {
            "measure": PRESSURE,
            "value": pressure,
            "unit": "mmHg",
            "finding": f"infarct in {infarcts} of {animals}",
            "species": "rat",
            "n": animals,
            "conditions": dose_response.CONDITIONS,
            "source": dose_response.SOURCE,
        }
        for pressure, (infarcts, animals) in dose_response.COUNTS.items()
    ]
    low, *middle, high = MPS_THRESHOLDS
    for value in (low, *middle, high):
        found.append(
            {
                "measure": STRAIN,
                "value": value,
                "unit": "",
                "finding": "threshold of axonal injury",
                "species": "guinea pig",
                "n": None,
                "conditions": "optic nerve, stretched in milliseconds: an upper guide for minutes",
                "source": "Bain & Meaney 2000, 10.1115/1.1324667",
            }
        )
    return found


def assumptions(case: Case, patient: Prior, stiffness: RelativeStiffness) -> list[str]:
    """What the answer assumes, a sentence each.

    Parameters
    ----------
    case : Case
    patient : Prior
    stiffness : RelativeStiffness

    Returns
    -------
    list of str
    """
    found = [f"spread of {note}" for note in patient.notes]
    low, high = case.link.exponent
    if stiffness.measured is not None:
        found += [
            f"waves are used as a ratio r to the norm {case.norm!r}: the stiffness of seconds goes with r to a power of {low:g} to "
            f"{high:g}",
            f"errors of the map are alike over {1e3 * stiffness.correlation:.0f} mm; beyond its intervals it is off by a factor of "
            f"{case.stiffness.map_factor if case.stiffness else 1:g} (resolution, model of the inversion)",
        ]
    else:
        found.append("without waves every place has the catalogue's law, up to differences from person to person")
    found += [
        f"{lesion.name} is {lesion.ratio:g} times as stiff as the tissue around it, by a factor of {lesion.ratio_factor:g}: its "
        "prior, not the map"
        for lesion in stiffness.lesion_priors
    ]
    return [
        *found,
        "gravity, drained fluid and swelling are not part of a plan's linearised model and are not drawn",
        "the geometry of the head and the corridors are taken as known",
    ]


def evidence(runs: bool, bound: bool, measured: bool) -> list[dict[str, str]]:
    """The credibility table: factor, evidence, and where it is found.

    Parameters
    ----------
    runs : bool
        Whether whole runs corrected the linearisation.
    bound : bool
        Whether another mesh bounded the numerical error.
    measured : bool
        Whether the patient's stiffness was measured.

    Returns
    -------
    list of dict
        `factor`, `evidence` ("none" where there is none), `tests`.
    """
    rows = (
        (
            "Software quality",
            "unit tests, checks of types and of the order of packages in every change",
            "tests/",
        ),
        (
            "Verification of the code",
            "closed forms, manufactured solutions and published benchmarks of the mechanics",
            "tests/verification/",
        ),
        (
            "Verification of gradients",
            "Taylor and dot-product tests of runs with contact and relaxation; of this linearisation against whole runs",
            "tests/forward/sensitivity/, tests/surgery/twin/test_plan_model.py",
        ),
        (
            "Verification of this calculation",
            ("a run on other elements as a bound; " if bound else "no run on other elements; ")
            + ("whole runs with draws of the patient" if runs else "no whole runs: the linearisation is not checked"),
            "numerical_factor and residuals in result.json",
        ),
        ("Validation of the mechanics", "none on this patient; laws are fitted to tissue ex vivo", "none"),
        (
            "Validation of the stiffness",
            "the inversion is tested on synthetic waves and phantoms" if measured else "no stiffness was measured",
            "tests/inverse/, benchmarks/results/elastography.md" if measured else "none",
        ),
        (
            "Coverage of intervals and correctness of decisions",
            "none: no study on a population of patients yet",
            "none",
        ),
        (
            "Common draws",
            "draws made apart for each plan can turn a choice round that common draws make right",
            "tests/stability/test_common_draws.py",
        ),
        (
            "Relevance to the context of use",
            "none: thresholds are of animals; nothing says what a patient gains",
            "none",
        ),
    )
    return [{"factor": factor, "evidence": words, "tests": tests} for factor, words, tests in rows]
