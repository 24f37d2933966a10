"""Checks of region and boundary patterns, before anything is computed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import ngsolve as ngs

from ngbrain.arguments import check_type
from ngbrain.errors import InputError, nearest
from ngbrain.forward.common.material import Material
from ngbrain.schema.patterns import MOST, REPEATS, ways


def check_types(mesh: ngs.Mesh, materials: Mapping[str, Material], supports: Mapping[str, object]) -> None:
    """Check the types of a problem's arguments.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    materials : dict
        Region pattern → `Material`.
    supports : dict
        Boundary pattern → support.

    Raises
    ------
    InputError
        For anything else.
    """
    check_type("mesh", mesh, ngs.Mesh)
    check_type("materials", materials, Mapping)
    check_type("supports", supports, Mapping)
    for pattern, material in materials.items():
        check_type(f"materials[{pattern!r}]", material, Material)


def check_regions(mesh: ngs.Mesh, patterns: Iterable[str], kind: str = "tissue") -> None:
    """Check that every region is matched by exactly one pattern.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    patterns : iterable of str
        Region patterns.
    kind : str
        What the patterns assign, for messages.

    Raises
    ------
    InputError
        For a region that no pattern or several match, and a pattern that matches nothing.
    """
    names, covered = mesh.GetMaterials(), set[int]()
    for pattern in patterns:
        found = _matches(f"{kind} region", pattern, mesh.Materials, names)
        if twice := {names[i] for i in found & covered}:
            wanted = f"a pattern without {', '.join(sorted(twice))}, which has a {kind} already"
            raise InputError(f"{kind} region", repr(pattern), wanted)
        covered |= found
    if bare := {name for i, name in enumerate(names) if i not in covered}:
        raise InputError(kind, f"not given for {', '.join(sorted(bare))}", f"a {kind} for every region of the mesh")


def boundaries(mesh: ngs.Mesh, pattern: str) -> set[int]:
    """Indices of the boundaries that a pattern matches.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    pattern : str
        Name or regular expression.

    Returns
    -------
    set of int

    Raises
    ------
    InputError
        If it matches none, or is not a valid pattern.
    """
    return _matches("boundary", pattern, mesh.Boundaries, mesh.GetBoundaries())


def check_apart(mesh: ngs.Mesh, fixed: str, touched: Iterable[str]) -> None:
    """Check that no boundary is both constrained and in contact with a rigid body.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    fixed : str
        Pattern of the constrained boundaries; "" for none.
    touched : iterable of str
        Patterns of the boundaries in contact.

    Raises
    ------
    InputError
        For a boundary that is both.
    """
    names, loose = mesh.GetBoundaries(), set[int]().union(*(boundaries(mesh, t) for t in touched))
    if both := boundaries(mesh, fixed) & loose if fixed else set():
        wanted = (
            f"a pattern without {', '.join(sorted({names[i] for i in both}))}, which is in contact with a rigid body"
        )
        raise InputError("boundary", repr(fixed), wanted)


def _matches(kind: str, pattern: str, find: Callable[[str], ngs.Region], names: Sequence[str]) -> set[int]:
    """Which regions or boundaries a pattern matches; `InputError` if none, or if it is no pattern."""
    if ways(pattern) > MOST:  # NGSolve would try for minutes, and ignore Ctrl-C
        raise InputError(kind, repr(pattern), f"a name or a regular expression with {REPEATS}")
    try:
        found = {i for i, match in enumerate(find(pattern).Mask()) if match}
    except RuntimeError as error:
        raise InputError(kind, repr(pattern), f"a name or a regular expression ({error})") from error
    if not found:
        raise InputError(kind, repr(pattern), nearest(pattern, set(names)))
    return found
