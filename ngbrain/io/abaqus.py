"""Nodes, tetrahedra, triangles and element sets of Abaqus input files.

meshio's reader keeps only the last *NODE block, mixes up element sets that several *ELEMENT blocks share, and supports neither
first-order hybrid tetrahedra (C3D4H) nor most triangles.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ngbrain.errors import InputError
from ngbrain.look import BriefText
from ngbrain.reading import MOST, read_text

_TETRAHEDRON = re.compile(r"(?:AC|D)?C3D(4|10)[A-Z]*")
_TRIANGLE = re.compile(r"(?:CPS|CPE|CPEG|CAX|M3D|SFM3D|S|DS|STRI|R3D|F3D)(3|6|65)[A-Z]*")
_OTHER_SOLID = re.compile(r"(?:AC|D)?C3D\d+[A-Z]*")
_NODES = {"3": 3, "4": 4, "6": 6, "65": 6, "10": 10}
"""Number of nodes, by the number in the element type."""


@dataclass(eq=False, repr=False)
class AbaqusMesh(BriefText):
    """Content of an input file: cells by their corners, as rows of `points`.

    Parameters
    ----------
    points : numpy.ndarray
        (n, 3), in the unit of the file.
    solid, flat : dict of numpy.ndarray
        Element set → corners of its tetrahedra (m, 4), and of its triangles (m, 3).
    others : dict of int
        Element type → number of solid elements that are not tetrahedra.
    """

    points: np.ndarray
    solid: dict[str, np.ndarray]
    flat: dict[str, np.ndarray]
    others: dict[str, int]


@dataclass
class _Content:
    nodes: dict[int, tuple[float, ...]] = field(default_factory=dict)
    cells: dict[int, list[int]] = field(default_factory=dict)
    """Element number → its corners."""
    sets: dict[str, list[int]] = field(default_factory=dict)
    others: dict[str, int] = field(default_factory=dict)


def read_abaqus(path: Path) -> AbaqusMesh:
    """Read one part of an Abaqus input file.

    Parameters
    ----------
    path : Path
        An .inp file with nodes and elements.

    Returns
    -------
    AbaqusMesh
        Only the corners of quadratic elements; lines, springs, quadrilaterals and masses are ignored.

    Raises
    ------
    InputError
        The file has several parts, includes other files, has invalid numbers, or lacks nodes.
    """
    read, parts = _Content(), 0
    try:
        for keyword, options, lines in _blocks(path):
            if keyword == "INCLUDE":
                raise InputError("mesh file", "one that includes others", "nodes and elements in one file", path)
            if keyword == "PART":
                parts += 1
            elif keyword == "NODE":
                for line in lines:
                    number, *place = line.split(",")
                    x = [float(value) for value in place[:3]]
                    read.nodes[int(number)] = (*x, *[0.0] * (3 - len(x)))
            elif keyword == "ELEMENT":
                _elements(read, options, lines)
            elif keyword == "ELSET":
                _set(read, options, lines)
        if parts > 1:
            raise InputError("mesh file", f"with {parts} parts", "one part", path)
        row = {number: i for i, number in enumerate(read.nodes)}
        by_corners: dict[int, dict[str, np.ndarray]] = {4: {}, 3: {}}
        named = {number for members in read.sets.values() for number in members}
        sets = {**read.sets, "": [number for number in read.cells if number not in named]}
        for corners, found in by_corners.items():
            for name, members in sets.items():
                mine = [read.cells[n] for n in dict.fromkeys(members) if len(read.cells.get(n, ())) == corners]
                if mine:
                    found[name] = np.array([[row[node] for node in cell] for cell in mine], np.int64)
    except (ValueError, KeyError) as error:
        found_ = f"unreadable ({type(error).__name__} {error})"
        raise InputError("mesh file", found_, "an input file of Abaqus' with its nodes", path) from error
    points = np.array(list(read.nodes.values()), float).reshape(-1, 3)
    return AbaqusMesh(points, by_corners[4], by_corners[3], read.others)


def _blocks(path: Path) -> Iterator[tuple[str, dict[str, str], list[str]]]:
    """Keywords with their options, upper case, and their data lines."""
    keyword, options, lines = "", dict[str, str](), list[str]()
    open_line = False
    for raw in read_text(path, "mesh file", MOST).splitlines():
        line = raw.strip()
        if not line or line.startswith("**"):
            continue
        if line.startswith("*") or open_line:
            if not open_line:
                if keyword:
                    yield keyword, options, lines
                keyword, options, lines = "", {}, []
            words = line.lstrip("*").split(",")
            if not keyword:
                keyword = words.pop(0).strip().upper()
            for word in words:
                name, _, value = word.partition("=")
                options[name.strip().upper()] = value.strip().strip('"')
            open_line = line.endswith(",")
        else:
            lines.append(line)
    if keyword:
        yield keyword, options, lines


def _elements(read: _Content, options: dict[str, str], lines: list[str]) -> None:
    kind = options["TYPE"].upper()
    solid, flat = _TETRAHEDRON.fullmatch(kind), _TRIANGLE.fullmatch(kind)
    if not (solid or flat):
        if _OTHER_SOLID.fullmatch(kind):
            read.others[kind] = read.others.get(kind, 0) + len(lines)
        return
    count = _NODES[(solid or flat).group(1)]  # type: ignore[union-attr]
    numbers = [int(word) for line in lines for word in line.split(",") if word.strip()]
    rows = np.array(numbers, np.int64).reshape(-1, count + 1)
    for number, *nodes in rows.tolist():
        read.cells[number] = nodes[: 4 if solid else 3]
    if "ELSET" in options:
        read.sets.setdefault(options["ELSET"], []).extend(rows[:, 0].tolist())


def _set(read: _Content, options: dict[str, str], lines: list[str]) -> None:
    mine = read.sets.setdefault(options["ELSET"], [])
    words = [[word.strip() for word in line.split(",") if word.strip()] for line in lines]
    if "GENERATE" in options:
        for first, last, *step in words:
            mine += range(int(first), int(last) + 1, int(step[0]) if step else 1)
        return
    for word in (word for line in words for word in line):
        mine += [int(word)] if word.isdigit() else read.sets[word]
