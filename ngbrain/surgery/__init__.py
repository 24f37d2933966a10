"""Simulated brain retraction: tools, protocols, runs, measures of tissue injury, uncertainty and calibration.

`ngbrain.simulate` runs a scene, `ngbrain.calibrate` fits tissue stiffness; the names below are their parts.

- heads: `load_head` of a scene, `IdealisedHead`, `ScannedHead`
- tools: `make_tools` of a scene, `Spatula`, `Tube`, `Ball`, `ClosedSurface`; `RigidTool` is the interface
- protocols: `continuous_retraction`, `intermittent_retraction`, `staged_retraction` (a `ToolMotion` each), `ForceProtocol`;
  `Drive` moves a tool
- runs: `RetractionModel`, `ProtocolRun`, `ProtocolResult`, `to_columns`
- measures: `answer` of a run, `Observer`, `retraction_observables`, `Sites`, `TissueSample`, `von_mises`, `dose`,
  `infarct_probability`
- one tissue column: `Column`, `LoadingHistory`, `dose_with_recovery`
- plans of a patient compared (`ngbrain.twin`): `Case` (the patient and the plans), `Norm` (moduli of healthy tissue)
- calibration: `Observations`, `CalibrationModel` (the model), `Calibration` (the result)

Modules
-------
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
- `twin`: One patient's plans compared, with what is not known of the tissue carried through.
- `plausibility`, `corridor`: Warnings for implausible moduli and for corridors near the mid plane.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.surgery import (
        answers,
        calibrate,
        corridor,
        head_models,
        material_point,
        measures,
        model,
        model_selection,
        observations,
        plausibility,
        protocol_run,
        protocols,
        quantities,
        relative_stiffness,
        retraction,
        tools,
        twin,
        uncertainty,
    )
    from ngbrain.surgery.answers import answer
    from ngbrain.surgery.calibrate import Calibration, CalibrationModel
    from ngbrain.surgery.head_models import IdealisedHead, ScannedHead, load_head
    from ngbrain.surgery.material_point import Column, LoadingHistory, dose_with_recovery
    from ngbrain.surgery.measures.dose_response import infarct_probability
    from ngbrain.surgery.measures.injury import dose, von_mises
    from ngbrain.surgery.measures.observer import Observer, retraction_observables
    from ngbrain.surgery.measures.sampling import Sites, TissueSample
    from ngbrain.surgery.model import RetractionModel
    from ngbrain.surgery.observations import Observations
    from ngbrain.surgery.protocol_run import ProtocolResult, ProtocolRun, to_columns
    from ngbrain.surgery.protocols import (
        Drive,
        ForceProtocol,
        ToolMotion,
        continuous_retraction,
        intermittent_retraction,
        staged_retraction,
    )
    from ngbrain.surgery.tools import make_tools
    from ngbrain.surgery.tools.base import RigidTool
    from ngbrain.surgery.tools.blades import Ball, Spatula, Tube
    from ngbrain.surgery.tools.closed_surface import ClosedSurface
    from ngbrain.surgery.twin.case import Case
    from ngbrain.surgery.twin.norms import Norm
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "Ball",
    "Calibration",
    "CalibrationModel",
    "Case",
    "ClosedSurface",
    "Column",
    "Drive",
    "ForceProtocol",
    "IdealisedHead",
    "LoadingHistory",
    "Norm",
    "Observations",
    "Observer",
    "ProtocolResult",
    "ProtocolRun",
    "RetractionModel",
    "RigidTool",
    "ScannedHead",
    "Sites",
    "Spatula",
    "TissueSample",
    "ToolMotion",
    "Tube",
    "answer",
    "answers",
    "calibrate",
    "continuous_retraction",
    "corridor",
    "dose",
    "dose_with_recovery",
    "head_models",
    "infarct_probability",
    "intermittent_retraction",
    "load_head",
    "make_tools",
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
    "retraction_observables",
    "staged_retraction",
    "to_columns",
    "tools",
    "twin",
    "uncertainty",
    "von_mises",
]
