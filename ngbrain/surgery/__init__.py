"""Simulated brain retraction: tools, protocols, runs, measures of tissue injury, uncertainty and calibration.

- `model`: A scene's mesh, tissues, tools and contacts; it builds transient problems (`RetractionModel`).
- `head_models`: Heads to operate on: the idealised head and heads from T1 scans.
- `tools`: Retractors as rigid bodies with a signed distance.
- `protocols`: Prescribed tool motion or force over time.
- `protocol_run`: One protocol from rest to end, with checkpoints and records.
- `retraction`: All protocols of a scene with their verification runs, to `result.json`.
- `answers`, `quantities`: The numbers of a protocol's answer and what they are of.
- `measures`: Forces, pressures, strain, injury and perfusion of a run.
- `uncertainty`: Error budget, spread of published materials, verification runs.
- `calibrate`, `observations`: Tissue stiffness from measured landmarks and forces.
- `model_selection`: The cheapest model of an operation that is within given tolerances.
- `material_point`: A retraction of one homogeneous tissue column.
- `relative_stiffness`: Measured stiffness maps as ratios.
- `plausibility`, `corridor`: Warnings for implausible moduli and for corridors near the mid plane.
"""

__all__ = [
    "answers",
    "calibrate",
    "corridor",
    "head_models",
    "material_point",
    "measures",
    "model",
    "model_selection",
    "observations",
    "plausibility",
    "protocol_run",
    "protocols",
    "quantities",
    "relative_stiffness",
    "retraction",
    "tools",
    "uncertainty",
]
