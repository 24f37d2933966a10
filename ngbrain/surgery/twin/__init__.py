"""The digital twin: one patient from what is known of the stiffness to the comparison of surgical plans.

- `case`: The case file: base scene, stiffness data, link, lesions, craniotomy and plans.
- `norms`: Moduli of normal tissue at the frequencies of elastography, which a patient's are compared with.
- `stiffness`: The patient's relative stiffness at points, with its standard deviation.
- `waves`: A map of the stiffness from an inversion of waves.
- `prior`: Uncertain parameters, their prior, and draws that all plans share.
- `plan_model`: A plan as a differentiable model: one run, its gradients, and runs at other parameters.
- `response`: Linearised measures of a plan.
- `spectrum`: The second way from waves to a retraction, by a spring-pot.
- `comparison`: Medians, intervals, differences and decisions; what the variance comes from.
- `crossings`: What the corridor of a plan crosses.
- `slices`: Plane sections of the head for figures.
- `credibility`: Published thresholds, assumptions, and the evidence behind each part.
- `tasks`: What is computed for a plan.
- `compute`: All of it for one case.
"""

__all__ = [
    "case",
    "comparison",
    "compute",
    "credibility",
    "crossings",
    "norms",
    "plan_model",
    "prior",
    "response",
    "slices",
    "spectrum",
    "stiffness",
    "tasks",
    "waves",
]
