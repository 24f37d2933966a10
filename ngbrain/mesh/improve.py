"""Flat tetrahedra made rounder by moving their corners, those on a surface along it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ngbrain.mesh.elements import Elements, smallest_angles
from ngbrain.mesh.levelset import LevelSet
from ngbrain.mesh.quality import radius_ratios

WANTED = 12.0
"""Score below which the corners of a tetrahedron are moved: the smaller of its least dihedral angle (°) and"""
PER_RATIO = 100.0
"""so many times its radius ratio."""
ROUNDS = 12
REACHES = (0.35, 0.15, 0.05, 0.015)
"""Lengths that a corner is moved by, as parts of the shortest edge around it times four."""
WAYS = 20
"""Directions, another set for every corner."""


def improved(elements: Elements, onto: Mapping[str, LevelSet], seed: int = 0) -> Elements:
    """The same mesh with corners of flat tetrahedra moved to where the worst around them is best.

    Corner by corner, of positions tried at random the best (Freitag and Ollivier-Gooch 1997,
    10.1002/(SICI)1097-0207(19971115)40:21<3979::AID-NME251>3.0.CO;2-9); the worst around a corner never gets worse.

    onto   boundary name → φ of that surface, on whose levels corners move; corners on another one, or on two, stay
    """
    points, tets = elements.points.copy(), elements.tets
    movable, surface = _corners(elements, onto)
    order = np.argsort(tets.ravel(), kind="stable")
    start = np.searchsorted(tets.ravel()[order], np.arange(len(points) + 1))
    rng = np.random.default_rng(seed)
    for _ in range(ROUNDS):
        flat = np.flatnonzero(_scores(points[tets]) < WANTED)
        moved = False
        for v in np.unique(tets[flat]).tolist():
            if not movable[v]:
                continue
            around = tets[order[start[v] : start[v + 1]] // 4]
            now = float(_scores(points[around]).min())
            if now >= WANTED:
                continue
            others = points[around[around != v]]
            reach = 4 * np.linalg.norm(others - points[v], axis=1).min()
            ways = rng.normal(size=(WAYS, 3))
            ways /= np.linalg.norm(ways, axis=1)[:, None]
            tried = (points[v] + reach * np.array(REACHES)[:, None, None] * ways).reshape(-1, 3)
            if surface[v]:
                phi = onto[surface[v]]
                tried = phi.project(tried, float(phi(points[v])[0]))
            x = np.repeat(points[around][None], len(tried), axis=0)
            x[:, around == v] = tried[:, None]
            least = _scores(x.reshape(-1, 4, 3)).reshape(len(tried), -1).min(axis=1)
            best = int(least.argmax())
            if least[best] > now + 1e-3:
                points[v], moved = tried[best], True
        if not moved:
            break
    return replace(elements, points=points)


def _corners(elements: Elements, onto: Mapping[str, LevelSet]) -> tuple[np.ndarray, list[str]]:
    """Which corners may move, and the surface that each is on ("" inside)."""
    on = np.zeros((len(elements.boundaries), len(elements.points)), bool)
    for i in range(len(elements.boundaries)):
        on[i, elements.triangles[elements.boundary == i].ravel()] = True
    known = np.array([name in onto for name in elements.boundaries], bool)
    movable = (on.sum(axis=0) <= 1) & ~on[~known].any(axis=0)
    first = np.where(on.any(axis=0), on.argmax(axis=0), -1)
    return movable, ["" if i < 0 else elements.boundaries[i] for i in first]


def _scores(x: np.ndarray) -> np.ndarray:
    """Of tetrahedra (n, 4, 3) in Netgen's orientation; negative where one is inside out."""
    volume = np.einsum("ij,ij->i", x[:, 1] - x[:, 0], np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]))
    with np.errstate(invalid="ignore", divide="ignore"):
        score = np.nan_to_num(np.minimum(smallest_angles(x), PER_RATIO * radius_ratios(x)))
    return np.where(volume < 0, score, -1.0)
