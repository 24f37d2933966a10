"""Through time: `time_stepper`, and what chooses its steps (`step_control`)."""

__all__ = ["step_control", "time_stepper"]
