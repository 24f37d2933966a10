"""The second way from waves to a retraction: the measured spectrum, joined to the law by a spring-pot.

With the loss tangent tan δ a spring-pot has the exponent a = 2δ/π, and |G*| at ω gives its relaxation modulus at t seconds,

    G(t) = |G*| (ω t)^(-a) / Γ(1 - a) .

It takes the level of the stiffness from the waves, which the first way does not. Where plans rank differently by the two ways, the
choice depends on an assumption that no measurement of this patient supports.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.special import gamma

from ngbrain.materials.families import law_after, shear_modulus
from ngbrain.materials.viscous import viscous
from ngbrain.surgery.twin.plan_model import PlanModel
from ngbrain.surgery.twin.response import Response

Array = np.ndarray


def relaxation_modulus(modulus: float, loss_tangent: float, frequency: float, seconds: float) -> float:
    """Shear modulus of a spring-pot some seconds after a sudden strain.

    Parameters
    ----------
    modulus : float
        |G*| (Pa) at `frequency`.
    loss_tangent : float
        G″/G′.
    frequency : float
        Hz.
    seconds : float

    Returns
    -------
    float
        Pa.

    References
    ----------
    Koeller 1984, 10.1115/1.3167616.

    Examples
    --------
    >>> round(relaxation_modulus(1000.0, 1.0, 50.0, 1.0), 3)  # a = 1/2: 1000/√(ω π t)
    31.831
    """
    exponent = 2 / math.pi * math.atan(loss_tangent)
    return float(modulus * (2 * math.pi * frequency * seconds) ** -exponent / gamma(1 - exponent))


def spectrum_theta(plan: PlanModel, loss_tangent: float | None) -> Array:
    """θ of a plan by the measured spectrum.

    Parameters
    ----------
    plan : PlanModel
        Of a patient with a map.
    loss_tangent : float, optional
        Measured; by default that of the norm of each tissue.

    Returns
    -------
    (size,) array
    """
    stiffness, seconds = plan.stiffness, plan.model.scene.time.ramp
    assert stiffness.measured is not None
    centre, numbers = plan.theta(plan.patient.centre), len(plan.tissues)
    found = centre.copy()
    for i, tissue in enumerate(plan.model.scene.tissues):
        normal = stiffness.normal[tissue.region]
        if normal is not None:
            tangent = normal.loss_tangent if loss_tangent is None else loss_tangent
            level = relaxation_modulus(stiffness.reference, tangent, stiffness.measured.frequency, seconds)
            found[i] = math.log(level / float(shear_modulus(law_after(viscous(tissue.law()), seconds))))
    found[numbers + 2 :] = stiffness.log_map(plan.nodes)
    return found


def rank_by_spectrum(
    plans: Mapping[str, PlanModel], responses: Mapping[str, Response], loss_tangent: float | None
) -> dict[str, Any]:
    """Measures of the plans by the second way, and the pairs that it ranks otherwise than the first one.

    Parameters
    ----------
    plans, responses : mapping
        By plan.
    loss_tangent : float, optional
        As of `spectrum_theta`.

    Returns
    -------
    dict
        `answers` (plan → measure → value) and `ranked_differently` (pairs and measures).
    """
    answers = {
        name: {
            key: float(np.exp(log[0]))
            for key, log in responses[name].log_values(spectrum_theta(plan, loss_tangent)[None]).items()
        }
        for name, plan in plans.items()
    }
    names, otherwise = list(plans), []
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            for key, value in responses[first].values.items():
                here = value - responses[second].values[key]
                if here * (answers[first][key] - answers[second][key]) < 0:
                    otherwise.append({"first": first, "second": second, "measure": key})
    return {"answers": answers, "ranked_differently": otherwise}
