"""What models are: closed forms of bars, balls and waves."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest
from scipy.integrate import quad

from ngbrain.errors import InputError
from ngbrain.forward.observables.percentiles import weighted_percentile
from ngbrain.ladder.axes import axes_of, cheapest
from ngbrain.ladder.models.geometry import Meshes
from ngbrain.ladder.models.hierarchy import ModelHierarchy, _times, solve
from ngbrain.ladder.models.laws import relaxed_law
from ngbrain.ladder.models.waves import complex_modulus
from ngbrain.materials import RelaxingOgden
from ngbrain.mesh import block
from ngbrain.scene import DisplacementBC, Fluid, Geometry, Gravity, MeshSize, Quantity, Scene, Time, Tissue, Traction

BAR = Geometry(kind="block", size=(0.02, 0.03, 0.04))
FREE = (
    DisplacementBC(boundary="bottom", components="z"),
    DisplacementBC(boundary="left", components="x"),
    DisplacementBC(boundary="front", components="y"),
)
MU, NU, DOWN = 1e3, 0.3, 1e-3
ASKS = (
    Quantity(name="force", boundary="top"),
    Quantity(name="displacement", point=(0.01, 0, 0.04), direction=(1, 0, 0)),
    Quantity(name="strain", percentile=50),
)


def pressed(*asks: Quantity, far: float = DOWN, **given: object) -> Scene:
    """A bar whose top goes down and whose sides are free."""
    supports = (*FREE, DisplacementBC(boundary="top", value=(0, 0, -far), components="z"))
    return Scene(
        **(
            {
                "geometry": BAR,
                "mesh": MeshSize(largest=0.04),
                "tissues": (Tissue(mu=(MU,), poissons_ratio=NU),),
                "displacement_bcs": supports,
                "quantities": asks or ASKS,
            }
            | given
        )
    )


def model(scene: Scene, **levels: str) -> dict[str, str]:
    """The cheapest but for some levels."""
    return {**cheapest(axes_of(scene)), **levels}


def test_a_bar_has_its_force_its_width_and_its_strain() -> None:
    scene = pressed()
    strain = DOWN / 0.04
    found = solve(ModelHierarchy(scene), model(scene, space="solid")).answers
    youngs = 2 * MU * (1 + NU)
    assert found == pytest.approx([-youngs * strain * 0.02 * 0.03, NU * strain * 0.02, NU * strain], rel=1e-3)


def test_a_section_is_as_thick_as_the_block() -> None:
    scene = pressed()
    found = solve(ModelHierarchy(scene), model(scene)).answers
    youngs = 2 * MU * (1 + NU) / (1 - NU**2)
    assert found[0] == pytest.approx(-youngs * DOWN / 0.04 * 0.02 * 0.03, rel=1e-3)


def test_finite_strain_measures_green_lagrange() -> None:
    scene = pressed(ASKS[2], far=-8e-3)  # pulled to 1.2 times its height
    small, large = (
        solve(ModelHierarchy(scene), model(scene, space="solid", strain=s)).answers[0] for s in ("linear", "finite")
    )
    assert small == pytest.approx(0.2, rel=1e-4)
    assert large == pytest.approx((1.2**2 - 1) / 2, rel=1e-4)


def test_moduli_relax_as_the_history_of_a_ramp_says() -> None:
    mu, alpha, eta = (100.0, 300.0, 50.0), (-5.0, -10.0, -20.0), (600.0, 1.0)
    ramp, t = 1.5, 4.0
    law = relaxed_law(RelaxingOgden(mu, alpha, eta), ramp, t)
    for k in (1, 2):
        tau = eta[k - 1] / mu[k]
        expected = mu[k] / ramp * quad(lambda s, tau=tau: np.exp(-(t - s) / tau), 0, ramp)[0]
        assert law.mu[k] == pytest.approx(expected, rel=1e-9)
    assert law.mu[0] == 100.0 and law.alpha == alpha


@pytest.mark.parametrize("level", ["prony", "flowing"])
def test_bodies_with_a_memory_relax_as_the_closed_form_says(level: str) -> None:
    tissue = Tissue(mu=(400.0, 600.0), eta=(1200.0,), poissons_ratio=NU)
    walls = (
        FREE[0],
        DisplacementBC(boundary="left|right", components="x"),
        DisplacementBC(boundary="front|back", components="y"),
    )
    confined = (
        *walls,
        DisplacementBC(boundary="top", value=(0, 0, -DOWN), components="z"),
    )  # strains are the load's at all times
    scene = pressed(
        ASKS[0],
        replace(ASKS[0], when="ramp"),
        tissues=(tissue,),
        time=Time(ramp=1.0, end=4.0),
        displacement_bcs=confined,
    )
    bench = ModelHierarchy(scene)
    elastic = solve(bench, model(scene, time="relaxed")).answers
    remembered = solve(bench, model(scene, time=level)).answers
    assert remembered == pytest.approx(elastic, rel=2e-3)
    assert abs(elastic[1]) > 1.15 * abs(elastic[0])


def test_weight_and_pull_are_dead_loads() -> None:
    scene = pressed(ASKS[0])
    held = (DisplacementBC(boundary="bottom", components="z"), *FREE[1:])
    reaction = (Quantity(name="force", boundary="bottom"),)
    pulled = replace(
        scene, displacement_bcs=held, tractions=(Traction(boundary="top", value=(0, 0, 50.0)),), quantities=reaction
    )
    assert solve(ModelHierarchy(pulled), model(pulled, space="solid")).answers[0] == pytest.approx(
        -50 * 0.02 * 0.03, rel=1e-4
    )
    heavy = replace(scene, displacement_bcs=held, gravity=Gravity(acceleration=(0, 0, -9.81)), quantities=reaction)
    weight = 1040 * 9.81 * 0.02 * 0.03 * 0.04
    assert solve(ModelHierarchy(heavy), model(heavy, space="solid")).answers[0] == pytest.approx(weight, rel=1e-4)


def floating(fluid: Fluid | None, before: tuple[float, float, float] | None = None, swelling: float = 0.0) -> float:
    """Force (N) on the bottom of a heavy bar, by small strain."""
    tissue = Tissue(mu=(1e6,), poissons_ratio=0.3, density=1040.0, swelling=swelling)
    scene = pressed(
        Quantity(name="force", boundary="bottom"),
        tissues=(tissue,),
        displacement_bcs=FREE,
        gravity=Gravity(acceleration=(0, 0, -9.81), imaged=before),
        fluid=fluid,
    )
    return float(solve(ModelHierarchy(scene), model(scene, space="solid")).answers[0])


def test_a_fluid_carries_a_body_up_to_its_level() -> None:
    volume = 0.02 * 0.03 * 0.04
    assert floating(Fluid(density=1007.0)) == pytest.approx(33 * 9.81 * volume, rel=1e-3)
    assert floating(Fluid(density=1007.0, drained_to=0.01)) == pytest.approx(
        (1040 - 1007 / 4) * 9.81 * volume, rel=1e-3
    )
    assert floating(Fluid(density=1007.0), (0, 0, 9.81)) == pytest.approx(2 * 33 * 9.81 * volume, rel=1e-3)
    assert floating(Fluid(density=1007.0), (0, 0, -9.81)) == pytest.approx(0, abs=1e-9)
    with pytest.raises(
        InputError, match=r"fluid.drained_to_mm is 50; wanted: a height within the body, from 0 to 40 mm"
    ):
        floating(Fluid(density=1007.0, drained_to=0.05))


@pytest.mark.parametrize(("strain", "width"), [("linear", 0.03), ("finite", 1.09 ** (1 / 3) - 1)])
def test_a_free_bar_swells_the_same_in_all_directions(strain: str, width: float) -> None:
    tissue = Tissue(mu=(MU,), poissons_ratio=NU, swelling=0.09)
    scene = pressed(*ASKS[1:], tissues=(tissue,), displacement_bcs=FREE)
    assert "space" not in axes_of(scene) or axes_of(scene)["space"].levels[0] == "solid"
    aside, largest = solve(ModelHierarchy(scene), model(scene, strain=strain)).answers
    assert aside == pytest.approx(width * 0.02, rel=1e-4)
    assert largest == pytest.approx(0.03 if strain == "linear" else (1.09 ** (2 / 3) - 1) / 2, rel=1e-4)


@pytest.mark.parametrize("strain", ["linear", "finite"])
def test_a_boundary_that_slides_is_held_along_its_normal_alone(strain: str) -> None:
    sliding = (
        DisplacementBC(boundary="bottom", contact="sliding"),
        *FREE[1:],
        DisplacementBC(boundary="top", value=(0, 0, -DOWN), components="z"),
    )
    scene, held = pressed(displacement_bcs=sliding), pressed()
    wanted = solve(ModelHierarchy(held), model(held, space="solid", strain=strain)).answers
    found = solve(ModelHierarchy(scene), model(scene, space="solid", strain=strain, contact="all")).answers
    assert found == pytest.approx(wanted, rel=2e-3)
    stuck = solve(ModelHierarchy(scene), model(scene, space="solid", strain=strain, contact="none")).answers
    assert abs(stuck[0]) > 1.005 * abs(found[0])


def test_waves_without_inertia_and_loss_are_statics() -> None:
    scene = pressed()
    wave = replace(scene, time=Time(frequency=50.0))
    still = solve(ModelHierarchy(scene), model(scene, space="solid")).answers
    found = solve(ModelHierarchy(wave), model(wave, space="solid")).answers
    assert found[:2] == pytest.approx(np.abs(still[:2]), rel=1e-3)
    assert found[2] == pytest.approx(
        DOWN / 0.04, rel=1e-3
    )  # half a period later it is stretched as far as it was pressed


def test_a_shear_wave_has_its_amplitude() -> None:
    piece = Geometry(kind="block", size=(0.02, 0.02, 0.06))
    supports = (
        DisplacementBC(boundary="bottom", value=(1e-4, 0, 0)),
        DisplacementBC(boundary="left|right|front|back|top", components="yz"),
    )
    quantity = Quantity(name="displacement", point=(0, 0, 0.06), direction=(1, 0, 0))
    wave = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=piece,
        tissues=(Tissue(poissons_ratio=0.49, mu=(3e3,), loss_tangent=0.3),),
        displacement_bcs=supports,
        time=Time(frequency=40.0),
        quantities=(quantity,),
    )
    found = solve(ModelHierarchy(wave), model(wave, order="3", mesh="1", inertia="all", loss="all")).answers[0]
    k = 2 * np.pi * 40 * np.sqrt(1040 / (3e3 * (1 + 0.3j)))
    assert found == pytest.approx(1e-4 / abs(np.cos(k * 0.06)), rel=2e-3)


def test_what_touches_lets_a_bar_widen() -> None:
    face = DisplacementBC(boundary="top", value=(0, 0, -DOWN), contact="frictionless")
    scene = pressed(ASKS[0], displacement_bcs=(*FREE, face))
    free = -2 * MU * (1 + NU) * DOWN / 0.04 * 0.02 * 0.03
    touched, tied = (
        solve(ModelHierarchy(scene), model(scene, space="solid", order="2", contact=level)).answers[0]
        for level in ("all", "none")
    )
    assert touched == pytest.approx(free, rel=3e-3) and tied < 1.03 * free
    with pytest.raises(InputError, match="into the body"):
        up = replace(scene, displacement_bcs=(*FREE, replace(face, value=(0, 0, DOWN))))
        solve(ModelHierarchy(up), model(up, contact="all"))


@pytest.mark.parametrize("level", ["instantaneous", "flowing"])
def test_a_column_that_is_moved_at_once_pulls_by_its_impedance(level: str) -> None:
    """√(ρμ) times area and speed, as long as nothing has come back; its free end makes it nothing at rest."""
    piece = Geometry(kind="block", size=(0.02, 0.02, 0.06))
    supports = (
        DisplacementBC(boundary="bottom", value=(1e-4, 0, 0)),
        DisplacementBC(boundary="left|right|front|back|top", components="yz"),
    )
    tissue = Tissue(poissons_ratio=0.49, mu=(600.0, 400.0), eta=(4e4,))  # which takes 100 s to relax
    asks = tuple(Quantity(name="force", boundary="bottom", direction=(1, 0, 0), when=when) for when in ("ramp", "end"))
    course = Time(ramp=0.08, end=0.16)
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=piece,
        tissues=(tissue,),
        displacement_bcs=supports,
        time=course,
        quantities=asks,
    )
    moving = model(scene, order="2", mesh="1", space="solid", inertia="all", time=level)
    pull, push = solve(ModelHierarchy(scene), moving).answers
    impedance = np.sqrt(1040 * 1e3) * 4e-4
    assert pull == pytest.approx(impedance * 1e-4 / course.ramp, rel=0.03)
    assert push == pytest.approx(-2 * impedance * 1e-4 / course.ramp, rel=0.15)  # it is held, and the wave is back
    still = solve(ModelHierarchy(scene), {**moving, "inertia": "none", "time": "instantaneous"}).answers
    assert np.abs(still).max() < 1e-6 * pull


def test_with_mass_steps_are_as_short_as_waves_need_and_then_grow() -> None:
    scene = pressed(time=Time(ramp=0.02, end=2.0))
    bench = ModelHierarchy(scene)
    times, plain = _times(bench, model(scene, inertia="all"), 2.0), _times(bench, model(scene), 2.0)
    steps = np.diff(times)
    assert times[0] == 0 and times[-1] == pytest.approx(2.0) and 0.02 in times and len(plain) < len(times) < 60
    assert steps[0] <= bench.crossing / 12 + 1e-12 and np.all(steps[1:] <= 1.2 * steps[:-1])
    assert bench.crossing == pytest.approx(0.04 * np.sqrt(1040 / MU))


def test_moduli_of_waves() -> None:
    tissue = Tissue(poissons_ratio=0.49, mu=(400.0, 600.0), eta=(30.0,))
    omega = 20.0  # 1/τ
    assert complex_modulus(tissue, omega, True) == pytest.approx(400 + 300 + 300j)
    assert complex_modulus(tissue, omega, False) == pytest.approx(700)


def test_pieces_have_their_parts_and_halve() -> None:
    meshes = Meshes(
        Geometry(
            kind="block", size=(0.04, 0.04, 0.04), lesion_radius=0.008, lesion_centre=(0, 0, 0.02), plate=(0.01, 0.02)
        ),
        0.02,
    )
    coarse, fine, flat = meshes.mesh(0, False), meshes.mesh(1, False), meshes.mesh(0, True)
    assert fine.ne == 8 * coarse.ne
    area = ngs.Integrate(ngs.CF(1) * ngs.ds("plate"), coarse)
    ball = ngs.Integrate(ngs.CF(1) * ngs.dx("lesion"), fine)
    assert area == pytest.approx(0.01 * 0.02)
    assert ball == pytest.approx(4 / 3 * np.pi * 0.008**3, rel=0.01)
    assert ngs.Integrate(ngs.CF(1) * ngs.dx("lesion"), flat) == pytest.approx(np.pi * 0.008**2, rel=0.01)
    slot = Meshes(Geometry(kind="block", size=(0.04, 0.04, 0.04), slot=(0.004, 0.02)), 0.02).mesh(0, False)
    assert ngs.Integrate(ngs.CF(1) * ngs.ds("wall_plus"), slot) == pytest.approx(0.02 * 0.04)


def test_percentiles_count_volumes() -> None:
    values, volumes = np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 2.0])
    assert weighted_percentile(values, volumes, 50) == pytest.approx(2.0)
    assert weighted_percentile(values, volumes, 100) == 3.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"displacement_bcs": (DisplacementBC(boundary="botom"),)}, "botom"),
        ({"quantities": (Quantity(name="displacement", point=(1, 1, 1)),)}, "point_mm"),
        ({"quantities": (Quantity(name="strain", region="lesion"),)}, "region"),
        ({"tissues": (Tissue(poissons_ratio=0.49, region="lesion", mu=(1e3,)),)}, "tissue is none"),
    ],
)
def test_what_is_not_there_is_named(change: dict, said: str) -> None:
    scene = replace(pressed(), **change)
    with pytest.raises(InputError, match=said):
        solve(ModelHierarchy(scene), model(scene, space="solid"))


def test_a_region_of_interest_is_held_where_it_is_cut() -> None:
    piece = Geometry(kind="block", size=(0.08, 0.08, 0.02), plate=(0.008, 0.008))
    supports = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="plate", value=(0, 0, -DOWN)))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=piece,
        tissues=(Tissue(mu=(MU,), poissons_ratio=NU),),
        displacement_bcs=supports,
        quantities=(Quantity(name="force", boundary="plate"),),
    )
    bench = ModelHierarchy(scene)
    part, whole = (model(scene, extent=level, order="2") for level in ("near", "whole"))
    (a,), (b,) = (solve(bench, each).answers for each in (part, whole))
    assert np.ptp([v.point[0] for v in bench.mesh(part).vertices]) == pytest.approx(0.024)
    assert abs(a) > abs(b) > 0.5 * abs(a)  # held nearer it is stiffer
    assert "extent" not in axes_of(
        replace(scene, displacement_bcs=(*supports, DisplacementBC(boundary="left", components="x")))
    )
    assert "extent" not in axes_of(replace(scene, quantities=(Quantity(name="displacement", point=(0.03, 0, 0.02)),)))


def test_a_mesh_of_ones_own_is_taken_from_its_file(tmp_path) -> None:
    file = tmp_path / "cube.vol"
    block((0.02, 0.03, 0.04), 0.04).ngmesh.Save(str(file))
    piece = Geometry(unit="m", kind="mesh", file=str(file))
    asks = (ASKS[0], Quantity(name="displacement", point=(0.02, 0.01, 0.04), direction=(1, 0, 0)))
    scene = pressed(*asks, geometry=piece)
    assert not {"space", "extent"} & set(axes_of(scene))
    bench, youngs, strain = ModelHierarchy(scene), 2 * MU * (1 + NU), DOWN / 0.04
    found = solve(bench, model(scene, mesh="1")).answers
    assert found == pytest.approx([-youngs * strain * 0.02 * 0.03, NU * strain * 0.02], rel=1e-3)
    assert bench.mesh({"mesh": "1"}).ne == 8 * bench.mesh({"mesh": "0"}).ne
    with pytest.raises(InputError, match="file"):
        solve(
            ModelHierarchy(replace(scene, geometry=Geometry(unit="m", kind="mesh", file="missing.vol"))), model(scene)
        )
    with pytest.raises(InputError, match="file"):
        replace(scene, geometry=Geometry(unit="m", kind="mesh"))
