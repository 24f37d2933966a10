"""Out-of-distribution scores of squares like those of the training, and of others."""

import hashlib
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from algebraic_operator import algebraic, few, noisy

from ngbrain.errors import InputError
from ngbrain.surrogate.operator.encoding import GRAIN, MODALITIES, add_noise, modality
from ngbrain.surrogate.prediction.pretrained import DIGEST, WEIGHTS, ModelCard, Operator
from ngbrain.surrogate.prediction.tiling import TilePrediction
from ngbrain.surrogate.prediction.trust import auc, calibrate, scores


def looks(operator, data):
    u = data.displacement / data.side
    features = operator.kind.features(u, data.poisson)
    each = zip(u, data.frequency, data.poisson, features, *operator(features), strict=True)
    return [TilePrediction(operator.kind, *parts) for parts in each]


def with_noise(data, sigma=0.01):
    return replace(data, displacement=noisy(data.displacement, sigma))


def largest(operator, data, **changes):
    return [max(scores(replace(look, **changes), operator.card.trust).values()) for look in looks(operator, data)]


def test_scales_are_calibrated_so_that_they_cover_what_they_say():
    operator, data = algebraic(), with_noise(few("waves", "validation"))
    unit = operator.kind.unit(data.storage, data.frequency, 1000.0, data.side)
    truth = operator.kind.targets(data.storage, data.loss, unit)
    mean, scale = operator(operator.kind.features(data.displacement / data.side, data.poisson))
    covered = (np.abs(truth - mean) < 1.96 * scale).mean(axis=(0, 2, 3))
    np.testing.assert_allclose(covered, 0.95, atol=0.02)
    for share in (0.25, 0.5, 0.9):
        inside = np.abs(truth - mean) < operator.card.coverage_factors(share)[:, None, None] * scale
        np.testing.assert_allclose(inside.mean(axis=(0, 2, 3)), share, atol=0.03)
    again = calibrate(
        operator, few("waves"), few("waves", "validation")
    )  # a card that has been calibrated stays as it is
    np.testing.assert_allclose(again["temperature"], operator.card.temperature, rtol=1e-6)
    assert again["within"]["deviations"][1] == pytest.approx(operator.card.content["within"]["deviations"][1])
    assert operator.card.temperature[0] != 1


def test_shares_between_those_of_the_calibration_and_beyond_them():
    card = ModelCard({"within": {"shares": [0.5, 0.9], "deviations": [[0.4, 1.2], [1.0, 2.0]]}})
    np.testing.assert_allclose(card.coverage_factors(0.7), [0.8, 1.5])
    with pytest.raises(InputError, match=r"share is 0\.95; wanted: 0\.5 to 0\.9"):
        card.coverage_factors(0.95)
    with pytest.raises(InputError, match="card is without `within`"):
        ModelCard({}).coverage_factors(0.5)


def test_what_was_validated_on_is_within_its_bounds():
    operator = algebraic()
    trust = operator.card.trust
    found = largest(operator, with_noise(few("waves", "validation")))
    assert trust["threshold"] >= 1 and np.mean(np.array(found) <= trust["threshold"] + 1e-9) > 0.8


def test_ranges_are_those_of_the_training():
    data, ranges = few("waves"), algebraic().card.trust["ranges"]
    np.testing.assert_allclose(np.exp(ranges["frequency"]), [data.frequency.min(), data.frequency.max()])
    np.testing.assert_allclose(ranges["softness"], np.log10(1 - 2 * np.array([data.poisson.max(), data.poisson.min()])))
    medians = [np.log(np.median(each)) for each in data.storage]
    assert min(medians) <= ranges["modulus"][0][1] + 0.02 and max(medians) >= ranges["modulus"][1][1] - 0.02


@pytest.mark.parametrize(
    "name, changes",
    [
        ("modulus", {"frequency": 400.0}),
        ("softness", {"poisson": 0.4999999}),
        ("wavelength", {"mean": np.zeros((2, 31, 31))}),
        ("deviation", {"scale": np.full((2, 31, 31), 5.0)}),
        ("features", {"features": np.full((modality("waves").channels, 31, 31), 3.0)}),
        ("residual", {"mean": np.random.default_rng(0).normal(-5, 2, (2, 31, 31))}),
    ],
)
def test_each_number_rises_with_what_it_is_of(name, changes):
    operator = algebraic()
    look = looks(operator, with_noise(few("waves", "validation")))[1]
    trust = operator.card.trust
    before, after = (scores(each, trust)[name] for each in (look, replace(look, **changes)))
    assert before <= trust["threshold"] < after


def test_a_fifth_beyond_the_highest_and_the_lowest_frequency_is_well_over_the_bound():
    operator, data = algebraic(), few("waves")
    look = looks(operator, data)[0]
    for factor, expected in (
        (data.frequency.max() * 1.2, 1.823),
        (data.frequency.min() / 1.2, 1.823),
        (data.frequency[0], 0.0),
    ):
        assert scores(replace(look, frequency=factor), operator.card.trust)["frequency"] == pytest.approx(
            expected, abs=0.01
        )


def test_noise():
    operator, data = algebraic(), with_noise(few("waves", "validation"))
    noisier = with_noise(few("waves", "validation"), 0.1)
    plain, noise = ([scores(look, operator.card.trust) for look in looks(operator, each)] for each in (data, noisier))
    assert all(after["noise"] > 4 * before["noise"] for before, after in zip(plain, noise, strict=True))


def test_noise_with_the_longest_grain():
    """Correlated noise looks smoother, and is detected nevertheless."""
    operator, data = algebraic("compression"), few("compression", "validation")
    count = len(data.displacement)
    u = add_noise(data.displacement, np.full(count, 0.1), np.random.default_rng(0), np.full(count, GRAIN))
    found = [scores(look, operator.card.trust) for look in looks(operator, replace(data, displacement=u))]
    assert min(each["noise"] for each in found) > 1.5


def test_compression():
    operator, data = algebraic("compression"), with_noise(few("compression", "validation"))
    trust = operator.card.trust
    look = looks(operator, data)[0]
    plain = scores(look, trust)
    assert set(plain) == {"softness", "contrast", "noise", "jump", "features", "deviation", "residual", "boundary"}
    wrong = scores(replace(look, mean=3 * look.mean[:, ::-1]), trust)
    assert wrong["contrast"] > 1.5 > plain["contrast"] and wrong["residual"] > 2 * plain["residual"]


def test_area_under_the_curve():
    assert auc(np.arange(5), np.arange(5)) == 0.5 and auc(np.arange(5), np.arange(5, 9)) == 1
    assert auc(np.array([0, 1, 2, 3]), np.array([1.5])) == 0.5


def test_a_card_that_was_not_calibrated_says_so():
    with pytest.raises(InputError, match="without trust"):
        ModelCard({"modality": "waves"}).trust  # noqa: B018


def test_an_operator_that_answers_nothing_is_not_calibrated():
    class Failed:
        def run(self, _, given):
            return np.full((2, *given["features"].shape[:1], 2, 31, 31), np.nan)

    with pytest.raises(InputError, match="not finite"):
        calibrate(replace(algebraic(), session=Failed()), few("waves"), few("waves", "validation"))


def test_cards_and_weights_that_are_none(tmp_path):
    pytest.importorskip("onnxruntime")
    with pytest.raises(InputError, match="missing"):
        Operator.load(tmp_path, "waves")
    (tmp_path / "waves.json").write_text('{"modality": "sound"}')
    with pytest.raises(InputError, match=r"waves\.json.*modality"):
        ModelCard.read(tmp_path / "waves.json")
    with pytest.raises(InputError, match="missing"):
        ModelCard.read(tmp_path / "other.json")


def told_otherwise(card, path, value):
    """A card with one entry changed or removed."""
    changed = json.loads(json.dumps(card))
    *places, last = path
    at = changed
    for place in places:
        at = at[place]
    if value is None:
        del at[last]
    else:
        at[last] = value
    return changed


@pytest.mark.parametrize("name", MODALITIES)
def test_a_card_with_anything_else_in_it_is_refused(tmp_path, name):
    card = json.loads((WEIGHTS / f"{name}.json").read_text())
    path = tmp_path / f"{name}.json"
    path.write_text(json.dumps(card))
    ModelCard.read(path)
    some = next(key for key in card["trust"]["ranges"])
    places = [
        ("temperature",),
        ("within",),
        ("within", "shares"),
        ("within", "deviations"),
        ("trust",),
        ("trust", "axes"),
    ]
    places += [("trust", key) for key in ("ranges", "bounds", "threshold")] + [("trust", "ranges", some)]
    places += [("trust", "axes", key) for key in ("mean", "spread", "axes", "variance", "across")]
    places += [("trust", "bounds", key) for key in ("features", "noise")] + [
        ("within", "shares", 0),
        ("temperature", 0),
    ]
    for place in places:
        for value in ("text", -1.0, [], {}, [[1.0], [1.0, 2.0]], None):
            if value is None and len(place) == 1:
                continue  # a card may come before calibration
            path.write_text(json.dumps(told_otherwise(card, place, value)))
            with pytest.raises(InputError, match=f"{name}.json: (within|trust|temperature)"):
                ModelCard.read(path)


def test_weights_that_are_not_those_of_the_card_are_refused(tmp_path):
    """A modified graph that is still readable, for example with all moduli 10 % higher."""
    pytest.importorskip("onnxruntime")
    for suffix in ("json", "onnx"):
        shutil.copy(WEIGHTS / f"waves.{suffix}", tmp_path)
    Operator.load(tmp_path, "waves")
    weights, card = tmp_path / "waves.onnx", json.loads((tmp_path / "waves.json").read_text())
    raw = weights.read_bytes()
    for damaged, opens in ((raw[:-100] + bytes([raw[-100] ^ 1]) + raw[-99:], True), (raw[:5000], False)):
        weights.write_bytes(damaged)
        with pytest.raises(InputError, match=r"waves\.onnx: weights is not those that the card"):
            Operator.load(tmp_path, "waves")
        (tmp_path / "waves.json").write_text(json.dumps(card | {DIGEST: hashlib.sha256(damaged).hexdigest()}))
        if not opens:
            with pytest.raises(InputError, match="weights is unreadable"):
                Operator.load(tmp_path, "waves")
        (tmp_path / "waves.json").write_text(json.dumps(card))
