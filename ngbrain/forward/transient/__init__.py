"""Time stepping: `time_stepper` (`TimeStepper`, `run_load_history`) and the controllers of its steps, `step_control`."""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward.transient import step_control, time_stepper
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["step_control", "time_stepper"]
