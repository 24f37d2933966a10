"""Derivatives and the proof that they are right.

`reduced`: an inversion's objective as a function of its unknowns; `derived`: numbers made of a model's data (dose, time above a
threshold, amplitude, phase) as a model of their own; `check`: Taylor rates and the dot test.
"""

__all__ = ["check", "derived", "reduced"]
