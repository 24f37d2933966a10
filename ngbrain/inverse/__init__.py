"""Elastography: from waves to properties."""
