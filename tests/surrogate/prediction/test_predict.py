"""From wave data to maps: units, squares, loads, notes on omitted data, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from algebraic_operator import algebraic, few, square, uniform

from ngbrain.errors import InputError
from ngbrain.io.waves import WaveData
from ngbrain.surrogate.data.dataset import SIDES
from ngbrain.surrogate.prediction.predict import predict

SHEAR = 6e3 * (1 + 0.2j)


def off(found, truth):
    return np.linalg.norm(found - truth) / np.linalg.norm(truth)


def test_a_uniform_square_in_pascal():
    found = predict(uniform(), algebraic())
    assert np.median(found.maps["storage"]) == pytest.approx(SHEAR.real, rel=0.02)
    assert np.median(found.maps["loss"]) == pytest.approx(SHEAR.imag, rel=0.05)
    assert found.squares == 1 and not found.warnings and found.solves.forward == 0
    assert np.all(found.deviations["storage"] > 0) and found.maps["loss"].shape == (41**2,)


@pytest.mark.parametrize("size, density", [(2.0, 1.0), (1.0, 2.0)])
def test_size_frequency_and_density_that_come_to_the_same(size, density):
    """At the dynamically similar frequency the square moves alike, with the same moduli."""
    plain = uniform()
    given = {"points": size * plain.points, "density": density * plain.density, "truth": {}, "dirichlet": None}
    other = replace(plain, frequency=plain.frequency / (size * density**0.5), **given)
    one, same = predict(plain, algebraic()), predict(other, algebraic())
    np.testing.assert_allclose(same.maps["storage"], one.maps["storage"], rtol=1e-9)
    np.testing.assert_allclose(same.deviations["loss"], one.deviations["loss"], rtol=1e-9)
    assert same.scores == pytest.approx(one.scores, rel=1e-6)


def test_elastic_data_get_youngs_modulus():
    data = uniform(5e3, rheology="elastic")
    data = replace(data, truth={"youngs": np.full(41**2, 2.6 * 5e3)})
    found = predict(data, algebraic())
    assert set(found.maps) == {"youngs"} and np.median(found.maps["youngs"]) == pytest.approx(13e3, rel=0.02)


def test_a_bulk_modulus_stands_for_poissons_ratio():
    found = predict(uniform(9e3 * (1 + 0.2j), poisson=None, bulk=9e3 * 2 * 1.3 / (3 * 0.4)), algebraic())
    assert np.median(found.maps["storage"]) == pytest.approx(9e3, rel=0.02)
    (note,) = found.warnings
    assert float(note.split("taken as ")[1].split()[0]) == pytest.approx(0.3, abs=0.005)


def test_several_loads_are_averaged_by_their_certainty():
    plain = uniform()
    doubled = replace(plain, displacement=np.concatenate([plain.displacement] * 2), frequency=[50.0, 50.0])
    one, two = predict(plain, algebraic()), predict(doubled, algebraic())
    np.testing.assert_allclose(two.maps["storage"], one.maps["storage"])
    assert np.median(two.deviations["loss"] / one.deviations["loss"]) == pytest.approx(2**-0.5, rel=0.03)
    resting = replace(doubled, frequency=[50.0, 0.0])
    found = predict(resting, algebraic())
    assert any("static loads are left out" in note for note in found.warnings)
    np.testing.assert_allclose(found.maps["storage"], one.maps["storage"])
    half = doubled.displacement.copy()
    half[1, :, 0] = np.nan
    found = predict(replace(doubled, displacement=half), algebraic())
    assert any("without both components are left out, 1 of 2" in note for note in found.warnings)


def test_a_strip_and_a_hole():
    """Half-overlapping squares; the hole and points outside all squares stay empty, and are counted."""
    plain = uniform(across=61)
    rows = plain.points[:, 1] < 0.0801
    strip = WaveData(
        plain.points[rows], plain.displacement[:, rows], [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.3
    )
    found = predict(strip, algebraic())
    assert found.squares > 1 and np.isfinite(found.maps["storage"]).all()
    assert np.median(found.maps["storage"]) == pytest.approx(6e3, rel=0.03)
    mask = np.ones(61**2, bool)
    mask[61 * 5 + 5] = False
    found = predict(replace(plain, mask=mask), algebraic())
    empty = np.isnan(found.maps["storage"])
    assert empty[61 * 5 + 5] and 0 < empty.mean() < 0.3
    assert any(f"{empty.sum()} of 3721 points lie in no square" in note for note in found.warnings)
    assert found.scores["boundary"] > 0


def test_high_frequencies_are_looked_at_in_smaller_squares():
    plain = uniform(across=81)
    wide = np.ones(81**2, bool)
    wide[0] = False  # one that is whole stays one
    data = replace(plain, frequency=[110.0], mask=wide)
    low, high = predict(replace(data, frequency=[50.0]), algebraic()), predict(data, algebraic())
    assert high.scores["frequency"] <= 1 < high.squares and high.squares > low.squares


def pressed(**changes):
    """A compressed square, its axial displacement, and the truth."""
    data = few("compression", "validation")
    u = np.concatenate([np.full_like(data.displacement[0], np.nan), data.displacement[0]], axis=2)
    given = {"poisson": float(data.poisson[0]), "truth": {"youngs": data.storage[0].ravel()}, **changes}
    return square(u, SIDES["compression"], **given)


def test_compression_is_known_up_to_a_factor():
    found = predict(pressed(), algebraic("compression"))
    assert set(found.maps) == {"youngs"} and np.mean(found.maps["youngs"]) == pytest.approx(1)
    assert found.solves.forward == found.solves.factorisations == 1
    assert any("up to a constant factor" in note for note in found.warnings)


def test_a_shear_modulus_that_is_assumed_at_rest_is_said():
    notes = predict(pressed(poisson=None, bulk=1e5), algebraic("compression")).warnings
    assert any("a shear modulus of 6 kPa, which is assumed" in note for note in notes)


def test_the_axial_direction_is_found_and_turned():
    data = pressed()
    one = predict(data, algebraic("compression"))
    aside = data.displacement.reshape(31, 31, 2).swapaxes(0, 1)[..., ::-1]
    youngs = np.swapaxes(one.maps["youngs"].reshape(31, 31), 0, 1).ravel()
    turned = square(aside, SIDES["compression"], poisson=data.poisson)
    np.testing.assert_allclose(predict(turned, algebraic("compression")).maps["youngs"], youngs, rtol=1e-6)
    upside = square(-data.displacement.reshape(31, 31, 2)[::-1], SIDES["compression"], poisson=data.poisson)
    found = predict(upside, algebraic("compression"))
    np.testing.assert_allclose(found.maps["youngs"].reshape(31, 31)[::-1].ravel(), one.maps["youngs"], rtol=1e-6)
    assert found.scores["residual"] == pytest.approx(one.scores["residual"], rel=1e-3)


def test_both_components_at_rest_come_to_the_axial_one():
    data = pressed()
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, 31),), indexing="ij")
    both = data.displacement.copy()
    both[0, :, 0] = (1e-4 * (x - 0.5) * y).ravel()
    found = predict(replace(data, displacement=both), algebraic("compression"))
    np.testing.assert_allclose(found.maps["youngs"], predict(data, algebraic("compression")).maps["youngs"])
    assert np.isnan(found.data.displacement[..., 0]).all() and any(
        "only the axial component is used" in note for note in found.warnings
    )


def test_levels_of_overlapping_squares_agree():
    data = pressed()
    mask = np.ones(31**2, bool)
    mask[-1] = False
    one, several = predict(data, algebraic("compression")), predict(replace(data, mask=mask), algebraic("compression"))
    assert several.squares > 1
    known = np.isfinite(several.maps["youngs"])
    ratio = several.maps["youngs"][known] / one.maps["youngs"][known]
    assert np.std(np.log(ratio)) < 0.08


def test_a_wrong_answer_is_rejected_and_said():
    operator = algebraic()

    class Other:
        def run(self, names, given):
            mean, scale = operator.session.run(names, given)
            return 1.0 + 0.6 * mean[:, :, ::-1], scale

    data = few("waves", "validation")
    best = int(np.argmin([np.abs(f - 50) for f in data.frequency]))
    given = square(
        data.displacement[best], SIDES["waves"], frequency=data.frequency[best], poisson=float(data.poisson[best])
    )
    right, wrong = predict(given, operator), predict(given, replace(operator, session=Other()))
    assert right.scores["residual"] < wrong.scores["residual"]
    assert wrong.rejected and not wrong.usable and "residual" in wrong.reasons[0] and "contradict" in wrong.reasons[0]
    assert not right.rejected and right.score == max(right.scores.values())


@pytest.mark.parametrize(
    "changes, named",
    [
        ({"symmetry": "transversely_isotropic", "fibre": np.array([1.0, 0])}, "symmetry.*fibres"),
        ({"frequency": [0.0]}, "rheology.*at rest"),
        ({"displacement": uniform().displacement * [1, np.nan]}, "one component"),
    ],
)
def test_what_it_has_not_learnt_is_refused(changes, named):
    with pytest.raises(InputError, match=named):
        predict(replace(uniform(), truth={}, **changes), algebraic())


def test_an_operator_of_another_modality():
    with pytest.raises(InputError, match="operator is of compression"):
        predict(uniform(), algebraic("compression"))


def test_too_small_a_grid():
    with pytest.raises(InputError, match="26 × 26"):
        predict(uniform(across=21), algebraic())
