"""What models are: closed forms of bars, balls and waves."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest
from scipy.integrate import quad

from ngbrain.errors import InputError
from ngbrain.forward.observables.percentiles import weighted_percentile
from ngbrain.ladder.bodies import Bench, _times, relaxed_law, solve
from ngbrain.ladder.pieces import Meshes
from ngbrain.ladder.rungs import axes_of, cheapest
from ngbrain.ladder.waves import modulus
from ngbrain.materials import RelaxingOgden
from ngbrain.mesh import block
from ngbrain.scene.loading import Ask, Course, Given, Loading, Piece, Pull, Stuff

BAR = Piece(size=(0.02, 0.03, 0.04), cell=0.04)
FREE = (Given(boundary="bottom", along="z"), Given(boundary="left", along="x"), Given(boundary="front", along="y"))
MU, NU, DOWN = 1e3, 0.3, 1e-3
ASKS = (
    Ask(boundary="top"),
    Ask(quantity="displacement", point=(0.01, 0, 0.04), direction=(1, 0, 0)),
    Ask(quantity="strain", percentile=50),
)


def pressed(*asks: Ask, far: float = DOWN, **given: object) -> Loading:
    """A bar whose top goes down and whose sides are free."""
    supports = (*FREE, Given(boundary="top", by=(0, 0, -far), along="z"))
    return Loading(
        **({"piece": BAR, "stuff": (Stuff(mu=(MU,), poisson=NU),), "given": supports, "ask": asks or ASKS} | given)
    )


def model(scene: Loading, **levels: str) -> dict[str, str]:
    """The cheapest but for some levels."""
    return {**cheapest(axes_of(scene)), **levels}


def test_a_bar_has_its_force_its_width_and_its_strain() -> None:
    scene = pressed()
    strain = DOWN / 0.04
    found = solve(Bench(scene), model(scene, space="solid")).answers
    youngs = 2 * MU * (1 + NU)
    assert found == pytest.approx([-youngs * strain * 0.02 * 0.03, NU * strain * 0.02, NU * strain], rel=1e-3)


def test_a_section_is_as_thick_as_the_block() -> None:
    scene = pressed()
    found = solve(Bench(scene), model(scene)).answers
    youngs = 2 * MU * (1 + NU) / (1 - NU**2)
    assert found[0] == pytest.approx(-youngs * DOWN / 0.04 * 0.02 * 0.03, rel=1e-3)


def test_finite_strain_measures_green_lagrange() -> None:
    scene = pressed(ASKS[2], far=-8e-3)  # pulled to 1.2 times its height
    small, large = (solve(Bench(scene), model(scene, space="solid", strain=s)).answers[0] for s in ("linear", "finite"))
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
    tissue = Stuff(mu=(400.0, 600.0), eta=(1200.0,), poisson=NU)
    walls = (FREE[0], Given(boundary="left|right", along="x"), Given(boundary="front|back", along="y"))
    confined = (*walls, Given(boundary="top", by=(0, 0, -DOWN), along="z"))  # strains are the load's at all times
    scene = pressed(
        ASKS[0], replace(ASKS[0], when="ramp"), stuff=(tissue,), course=Course(ramp=1.0, elapsed=4.0), given=confined
    )
    bench = Bench(scene)
    elastic = solve(bench, model(scene, time="relaxed")).answers
    remembered = solve(bench, model(scene, time=level)).answers
    assert remembered == pytest.approx(elastic, rel=2e-3)
    assert abs(elastic[1]) > 1.15 * abs(elastic[0])


def test_weight_and_pull_are_dead_loads() -> None:
    scene = pressed(ASKS[0])
    held = (Given(boundary="bottom", along="z"), *FREE[1:])
    reaction = (Ask(boundary="bottom"),)
    pulled = replace(scene, given=held, pull=(Pull(boundary="top", traction=(0, 0, 50.0)),), ask=reaction)
    assert solve(Bench(pulled), model(pulled, space="solid")).answers[0] == pytest.approx(-50 * 0.02 * 0.03, rel=1e-4)
    heavy = replace(scene, given=held, course=Course(gravity=(0, 0, -1)), ask=reaction)
    weight = 1040 * 9.81 * 0.02 * 0.03 * 0.04
    assert solve(Bench(heavy), model(heavy, space="solid")).answers[0] == pytest.approx(weight, rel=1e-4)


def test_waves_without_inertia_and_loss_are_statics() -> None:
    scene = pressed()
    wave = replace(scene, course=Course(frequency=50.0))
    still = solve(Bench(scene), model(scene, space="solid")).answers
    found = solve(Bench(wave), model(wave, space="solid")).answers
    assert found[:2] == pytest.approx(np.abs(still[:2]), rel=1e-3)
    assert found[2] == pytest.approx(
        DOWN / 0.04, rel=1e-3
    )  # half a period later it is stretched as far as it was pressed


def test_a_shear_wave_has_its_amplitude() -> None:
    piece = Piece(size=(0.02, 0.02, 0.06), cell=0.02)
    supports = (Given(boundary="bottom", by=(1e-4, 0, 0)), Given(boundary="left|right|front|back|top", along="yz"))
    ask = Ask(quantity="displacement", point=(0, 0, 0.06), direction=(1, 0, 0))
    wave = Loading(
        piece=piece, stuff=(Stuff(mu=(3e3,), loss=0.3),), given=supports, course=Course(frequency=40.0), ask=(ask,)
    )  # fmt: skip
    found = solve(Bench(wave), model(wave, order="3", mesh="1", inertia="all", loss="all")).answers[0]
    k = 2 * np.pi * 40 * np.sqrt(1040 / (3e3 * (1 + 0.3j)))
    assert found == pytest.approx(1e-4 / abs(np.cos(k * 0.06)), rel=2e-3)


def test_what_touches_lets_a_bar_widen() -> None:
    face = Given(boundary="top", by=(0, 0, -DOWN), hold="touching")
    scene = pressed(ASKS[0], given=(*FREE, face))
    free = -2 * MU * (1 + NU) * DOWN / 0.04 * 0.02 * 0.03
    touched, tied = (
        solve(Bench(scene), model(scene, space="solid", order="2", contact=level)).answers[0]
        for level in ("all", "none")
    )
    assert touched == pytest.approx(free, rel=3e-3) and tied < 1.03 * free
    with pytest.raises(InputError, match="into the body"):
        up = replace(scene, given=(*FREE, replace(face, by=(0, 0, DOWN))))
        solve(Bench(up), model(up, contact="all"))


@pytest.mark.parametrize("level", ["instantaneous", "flowing"])
def test_a_column_that_is_moved_at_once_pulls_by_its_impedance(level: str) -> None:
    """√(ρμ) times area and speed, as long as nothing has come back; its free end makes it nothing at rest."""
    piece = Piece(size=(0.02, 0.02, 0.06), cell=0.02)
    supports = (Given(boundary="bottom", by=(1e-4, 0, 0)), Given(boundary="left|right|front|back|top", along="yz"))
    tissue = Stuff(mu=(600.0, 400.0), eta=(4e4,))  # which takes 100 s to relax
    asks = tuple(Ask(boundary="bottom", direction=(1, 0, 0), when=when) for when in ("ramp", "end"))
    course = Course(ramp=0.08, elapsed=0.16)
    scene = Loading(piece=piece, stuff=(tissue,), given=supports, course=course, ask=asks)
    moving = model(scene, order="2", mesh="1", space="solid", inertia="all", time=level)
    pull, push = solve(Bench(scene), moving).answers
    impedance = np.sqrt(1040 * 1e3) * 4e-4
    assert pull == pytest.approx(impedance * 1e-4 / course.ramp, rel=0.03)
    assert push == pytest.approx(-2 * impedance * 1e-4 / course.ramp, rel=0.15)  # it is held, and the wave is back
    still = solve(Bench(scene), {**moving, "inertia": "none", "time": "instantaneous"}).answers
    assert np.abs(still).max() < 1e-6 * pull


def test_with_mass_steps_are_as_short_as_waves_need_and_then_grow() -> None:
    scene = pressed(course=Course(ramp=0.02, elapsed=2.0))
    bench = Bench(scene)
    times, plain = _times(bench, model(scene, inertia="all"), 2.0), _times(bench, model(scene), 2.0)
    steps = np.diff(times)
    assert times[0] == 0 and times[-1] == pytest.approx(2.0) and 0.02 in times and len(plain) < len(times) < 60
    assert steps[0] <= bench.crossing / 12 + 1e-12 and np.all(steps[1:] <= 1.2 * steps[:-1])
    assert bench.crossing == pytest.approx(0.04 * np.sqrt(1040 / MU))


def test_moduli_of_waves() -> None:
    tissue = Stuff(mu=(400.0, 600.0), eta=(30.0,))
    omega = 20.0  # 1/τ
    assert modulus(tissue, omega, True) == pytest.approx(400 + 300 + 300j)
    assert modulus(tissue, omega, False) == pytest.approx(700)


def test_pieces_have_their_parts_and_halve() -> None:
    meshes = Meshes(Piece(size=(0.04, 0.04, 0.04), lesion=0.008, at=(0, 0, 0.02), plate=(0.01, 0.02), cell=0.02))
    coarse, fine, flat = meshes.at(0, False), meshes.at(1, False), meshes.at(0, True)
    assert fine.ne == 8 * coarse.ne
    area = ngs.Integrate(ngs.CF(1) * ngs.ds("plate"), coarse)
    ball = ngs.Integrate(ngs.CF(1) * ngs.dx("lesion"), fine)
    assert area == pytest.approx(0.01 * 0.02)
    assert ball == pytest.approx(4 / 3 * np.pi * 0.008**3, rel=0.01)
    assert ngs.Integrate(ngs.CF(1) * ngs.dx("lesion"), flat) == pytest.approx(np.pi * 0.008**2, rel=0.01)
    slot = Meshes(Piece(size=(0.04, 0.04, 0.04), slot=(0.004, 0.02), cell=0.02)).at(0, False)
    assert ngs.Integrate(ngs.CF(1) * ngs.ds("wall_plus"), slot) == pytest.approx(0.02 * 0.04)


def test_percentiles_count_volumes() -> None:
    values, volumes = np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 2.0])
    assert weighted_percentile(values, volumes, 50) == pytest.approx(2.0)
    assert weighted_percentile(values, volumes, 100) == 3.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"given": (Given(boundary="botom"),)}, "botom"),
        ({"ask": (Ask(quantity="displacement", point=(1, 1, 1)),)}, "point_mm"),
        ({"ask": (Ask(quantity="strain", region="lesion"),)}, "region"),
        ({"stuff": (Stuff(region="lesion", mu=(1e3,)),)}, "stuff"),
    ],
)
def test_what_is_not_there_is_named(change: dict, said: str) -> None:
    scene = replace(pressed(), **change)
    with pytest.raises(InputError, match=said):
        solve(Bench(scene), model(scene, space="solid"))


def test_a_region_of_interest_is_held_where_it_is_cut() -> None:
    piece = Piece(size=(0.08, 0.08, 0.02), plate=(0.008, 0.008), cell=0.02)
    supports = (Given(boundary="bottom"), Given(boundary="plate", by=(0, 0, -DOWN)))
    scene = Loading(piece=piece, stuff=(Stuff(mu=(MU,), poisson=NU),), given=supports, ask=(Ask(boundary="plate"),))
    bench = Bench(scene)
    part, whole = (model(scene, extent=level, order="2") for level in ("near", "whole"))
    (a,), (b,) = (solve(bench, each).answers for each in (part, whole))
    assert np.ptp([v.point[0] for v in bench.mesh(part).vertices]) == pytest.approx(0.024)
    assert abs(a) > abs(b) > 0.5 * abs(a)  # held nearer it is stiffer
    assert "extent" not in axes_of(replace(scene, given=(*supports, Given(boundary="left", along="x"))))
    assert "extent" not in axes_of(replace(scene, ask=(Ask(quantity="displacement", point=(0.03, 0, 0.02)),)))


def test_a_mesh_of_ones_own_is_taken_from_its_file(tmp_path) -> None:
    file = tmp_path / "cube.vol"
    block((0.02, 0.03, 0.04), 0.04).ngmesh.Save(str(file))
    piece = Piece(shape="mesh", file=str(file))
    asks = (ASKS[0], Ask(quantity="displacement", point=(0.02, 0.01, 0.04), direction=(1, 0, 0)))
    scene = pressed(*asks, piece=piece)
    assert not {"space", "extent"} & set(axes_of(scene))
    bench, youngs, strain = Bench(scene), 2 * MU * (1 + NU), DOWN / 0.04
    found = solve(bench, model(scene, mesh="1")).answers
    assert found == pytest.approx([-youngs * strain * 0.02 * 0.03, NU * strain * 0.02], rel=1e-3)
    assert bench.mesh({"mesh": "1"}).ne == 8 * bench.mesh({"mesh": "0"}).ne
    with pytest.raises(InputError, match="file"):
        solve(Bench(replace(scene, piece=Piece(shape="mesh", file="missing.vol"))), model(scene))
    with pytest.raises(InputError, match="file"):
        replace(scene, piece=Piece(shape="mesh"))
