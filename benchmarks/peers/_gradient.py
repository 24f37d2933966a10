"""What the scripts that time gradients share: the case's numbers, the command line, the clock, the check and the records.

python benchmarks/peers/NAME_gradient.py N ORDER TIMES      a JSON list of records
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import Any

import _case as c
import numpy as np

MU, BULK, MOVED, STEP = 1e3, 9.67e3, (1e-4 * c.L, 0.0, -1e-3 * c.L), 1e-3
EDGES = (0, 1, 0, 0, 1, 2), (1, 2, 2, 3, 3, 3)
"""First and second vertex of a tetrahedron's edges, in the order of their nodes."""

Ways = tuple[Callable[[], float], Callable[[], np.ndarray], Callable[[np.ndarray], float]]
"""J, its gradient just after, and J at other moduli."""


def varied(tetrahedra: int) -> np.ndarray:
    """They vary by a fifth."""
    return MU * (1 + 0.2 * np.random.default_rng(0).random(tetrahedra))


@dataclass(frozen=True)
class Cube:
    """The mesh for those that bring none of six tetrahedra per cell; nodes are vertices, of order 2 also the edges' midpoints."""

    n: int
    order: int

    @cached_property
    def nodes(self) -> np.ndarray:
        """Their places."""
        line = np.linspace(0, c.L, self.order * self.n + 1)
        return np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)

    @cached_property
    def tetrahedra(self) -> np.ndarray:
        """Their nodes: the six ways along a cell's edges from one corner to the opposite one."""
        steps = np.eye(3, dtype=int)[list(permutations(range(3)))]
        ways = np.concatenate([np.zeros((6, 1, 3), int), steps.cumsum(axis=1)], axis=1)
        mirrored = np.linalg.det(steps) < 0
        ways[mirrored] = ways[mirrored][:, [0, 2, 1, 3]]
        cells = np.stack(np.meshgrid(*[np.arange(self.n)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 1, 3)
        places = self.order * (cells + ways).reshape(-1, 4, 3)
        if self.order == 2:
            between = (places[:, EDGES[0]] + places[:, EDGES[1]]) // 2
            places = np.concatenate([places, between], axis=1)
        side = self.order * self.n + 1
        return places @ [side**2, side, 1]

    @cached_property
    def mass(self) -> np.ndarray:
        """The integrals of two shape functions over one tetrahedron: all are of one size."""
        x, w = np.polynomial.legendre.leggauss(4)
        p, q, r = np.meshgrid(*[(x + 1) / 2] * 3, indexing="ij")
        weight = (1 - p) ** 2 * (1 - q) * w[:, None, None] * w[:, None] * w / 8
        at = np.stack([p, (1 - p) * q, (1 - p) * (1 - q) * r, (1 - p) * (1 - q) * (1 - r)])
        shapes = at
        if self.order == 2:
            shapes = np.concatenate([at * (2 * at - 1), 4 * at[list(EDGES[0])] * at[list(EDGES[1])]])
        return np.einsum("ipqr,jpqr,pqr->ij", shapes, shapes, weight) * (c.L / self.n) ** 3

    @cached_property
    def moduli(self) -> np.ndarray:
        """One for each tetrahedron."""
        return varied(len(self.tetrahedra))


def arguments() -> tuple[int, int, int]:
    """Cells along a side, order, times to repeat."""
    n, order, times = map(int, sys.argv[1:4])
    return n, order, times


def known(order: int, tetrahedra: int, ndof: int | None, versions: dict[str, str]) -> dict[str, Any]:
    """What each record begins with."""
    case = {"case": "linear", "form": f"P{order}", "order": order, "tetrahedra": tetrahedra, "ndof": ndof}
    return case | {"converged": True, "versions": versions}


def timed(
    forward: Callable[[], float], gradient: Callable[[], np.ndarray], times: int
) -> tuple[dict[str, float], np.ndarray]:
    """CPU seconds of both, the least of several runs after a first; the gradient."""
    forward(), gradient()
    spent: list[tuple[float, float]] = []
    for _ in range(times):
        begun = c.cpu()
        value = forward()
        between = c.cpu()
        slope = gradient()
        spent.append((between - begun, c.cpu() - between))
    solved, derived = (min(each) for each in zip(*spent, strict=True))
    return {"forward_s": solved, "cpu_s": derived, "ratio": derived / solved, "value": value}, slope


def off(theta: np.ndarray, at: Callable[[np.ndarray], float], slope: np.ndarray) -> float:
    """Of the gradient along a random direction from a central difference."""
    direction = theta * np.random.default_rng(2).normal(size=len(theta))
    up, down = (at(theta + s * STEP * direction) for s in (1, -1))
    return float(abs((up - down) / (2 * STEP) / (slope @ direction) - 1))


def main(method: str, ways: Callable[[Cube], Ways], versions: dict[str, str]) -> None:
    """The record of a library that has tetrahedra of order 1 and 2."""
    n, order, times = arguments()
    record = {"method": method} | known(order, 6 * n**3, None, versions)
    if order > 2:
        nothing = dict.fromkeys(("forward_s", "cpu_s", "ratio", "value", "error"))
        record |= nothing | {"converged": False, "reason": f"not offered: order {order}"}
    else:
        cube = Cube(n, order)
        with redirect_stdout(sys.stderr):
            forward, gradient, at = ways(cube)
            found, slope = timed(forward, gradient, times)
            record |= found | {"ndof": cube.nodes.size, "error": off(cube.moduli, at, slope)}
    print(json.dumps([record]))
