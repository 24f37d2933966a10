"""Edges at which a body is torn: where faces that meet there are held and moved apart, forces have no limit."""

from __future__ import annotations

import re
from itertools import combinations

import ngsolve as ngs

from ngbrain.scene.loading import Given, Loading


def torn(scene: Loading, mesh: ngs.Mesh) -> list[str]:
    """What to doubt of forces that are asked for: finer elements make them larger, without end.

    >>> from ngbrain.mesh import block
    >>> from ngbrain.scene.loading import Ask, Given, Loading, Stuff
    >>> held = (Given(boundary="bottom"), Given(boundary="left", by=(-1e-3, 0, 0)))
    >>> len(torn(Loading(stuff=(Stuff(mu=(1e3,)),), given=held, ask=(Ask(boundary="left"),)), block()))
    1
    """
    asked = [ask.boundary for ask in scene.ask if ask.quantity == "force"]
    found = []
    for one, other in combinations([given for given in scene.given if given.hold == "tied"], 2):
        felt = any(re.fullmatch(pattern, name) for pattern in asked for name in _names(mesh, one) | _names(mesh, other))
        if felt and _apart(one, other) and _vertices(mesh, one) & _vertices(mesh, other):
            where = f"{one.boundary} and {other.boundary} meet at an edge and are held apart there"
            found.append(f"{where}: forces on them grow without end as elements get smaller")
    return found


def _apart(one: Given, other: Given) -> bool:
    shared = [axis for axis in one.along if axis in other.along]
    return any(one.by["xyz".index(axis)] != other.by["xyz".index(axis)] for axis in shared)


def _names(mesh: ngs.Mesh, given: Given) -> set[str]:
    return {name for name in mesh.GetBoundaries() if re.fullmatch(given.boundary, name)}


def _vertices(mesh: ngs.Mesh, given: Given) -> set[int]:
    return {vertex.nr for element in mesh.Boundaries(given.boundary).Elements() for vertex in element.vertices}
