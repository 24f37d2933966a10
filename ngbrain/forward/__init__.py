"""Equations and their solution: mixed bodies, contact, history, time stepping."""
