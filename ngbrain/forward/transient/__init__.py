"""Time stepping: `time_stepper` (`TimeStepper`, `run_load_history`) and the controllers of its steps, `step_control`."""

__all__ = ["step_control", "time_stepper"]
