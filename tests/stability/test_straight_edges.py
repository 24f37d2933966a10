"""A round body on straight edges. Naive: the mesh as it comes, with high order. Ours: the mesh curved to that order.

Errors, naive and ours: torque of a twisted cylinder, P3 on 111 tetrahedra, 6.7e-2 and 1.7e-4; pressure in a thick cylinder,
P4 on 192 triangles, 2.8e-3 and 1e-10, of order 2 and 7.
"""

import ngsolve as ngs
import numpy as np
import pytest
from finite_strain import Solid, cylinder, end_loads, opened, orders, quarter_of_a_ring, ring_pressure, torsion, twisted

from ngbrain.materials import NeoHooke


def torque_error(curved):
    solid = Solid(cylinder(0, curved), NeoHooke(1.0), 3, dirichlet="bottom|top")
    solid.u.Set(twisted(0.5))
    assert solid.solve().converged
    torque, _ = end_loads(solid.u, solid.forces(solid.state)[solid.is_u])
    return torque / torsion(0.5, 0.0, 0.5)[0] - 1


def pressure_errors(curved):
    """Of a thick cylinder opened by half, on three meshes, each half as fine as the next."""
    found = []
    for level in (0, 1, 2):
        solid = Solid(
            quarter_of_a_ring(level, curved), NeoHooke(1.0), 4, control="volume", dirichletx="x", dirichlety="y"
        )
        found.append(opened(solid, [1.2, 1.5])[-1] / ring_pressure(1.0, 1.5) - 1)
    return np.array(found)


def test_torque_of_a_cylinder_of_third_order():
    naive, ours = torque_error(1), torque_error(3)
    print("torque", naive, ours)
    assert abs(naive) > 0.04 and abs(ours) < 5e-4


def test_no_order_helps_on_straight_edges():
    naive, ours = pressure_errors(1), pressure_errors(4)
    print("pressure", naive, orders(naive), ours, orders(ours))
    assert orders(naive) == pytest.approx(2, abs=0.5) and abs(naive[-1]) > 1e-3
    assert np.all(orders(ours) > 6) and abs(ours[-1]) < 1e-8


def test_third_order_curves_bring_no_order_over_second():
    # What a ring's volume is wrong by: h², h⁴, h⁴, h⁶ on curves of order 1, 2, 3, 4.
    found = []
    for curved in (1, 2, 3, 4):
        volumes = [ngs.Integrate(ngs.CF(1), quarter_of_a_ring(level, curved), order=12) for level in (0, 1)]
        found.append(orders(np.array(volumes) / (0.75 * np.pi) - 1)[0])
    assert found == pytest.approx([2, 4, 4, 6], abs=0.3)
