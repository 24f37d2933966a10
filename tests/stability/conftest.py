"""Pairs: the naive way fails by a stated figure, ours survives by another."""
