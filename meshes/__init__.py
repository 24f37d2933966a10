"""Meshes that come with ngbrain, each with the make_*.py that regenerates it."""
