"""Training: noise and symmetries, normalisation by training data only, resumed runs, ONNX."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason='torch is not installed; get it with: pip install "ngbrain[train]"')

from ngbrain.errors import InputError  # noqa: E402
from ngbrain.surrogate.__main__ import _command, _trainings  # noqa: E402
from ngbrain.surrogate.data.dataset import DataSet, generate  # noqa: E402
from ngbrain.surrogate.operator.encoding import add_noise, modality, relative_errors, remove_affine  # noqa: E402
from ngbrain.surrogate.operator.wavelet_operator import WaveletOperator  # noqa: E402
from ngbrain.surrogate.training.training import (  # noqa: E402
    Learner,
    Settings,
    Surrogate,
    objective,
    predict_batches,
    train,
    turned,
)

torch.set_num_threads(1)


def small(channels: int, out: int) -> WaveletOperator:
    return WaveletOperator(channels, out, width=8, blocks=1, levels=2)


@pytest.fixture(scope="module", params=["waves", "compression"])
def sets(request, tmp_path_factory):
    """Sixteen samples to train with and four to validate with, on 26 points."""
    folder = tmp_path_factory.mktemp(request.param)
    for split, count in (("train", 16), ("validation", 4)):
        generate(folder / split, request.param, {"sinc": count}, split, across=26)
    return [DataSet.read(folder / split) for split in ("train", "validation")]


def test_noise_is_relative_to_what_is_not_affine(sets, rng):
    u = sets[0].displacement[:4]
    eta = add_noise(u, np.full(4, 0.1), rng) - u
    rms = np.sqrt((np.abs(remove_affine(u)) ** 2).mean(axis=(1, 2)))
    assert np.allclose(np.sqrt((np.abs(eta) ** 2).mean(axis=(1, 2))), 0.1 * rms, rtol=0.15)
    assert np.iscomplexobj(eta) == np.iscomplexobj(u)


@pytest.mark.parametrize("sets", ["waves"], indirect=True)
def test_what_is_turned_is_a_square_of_the_same_kind(sets, rng):
    """Channels of transformed waves correspond to transformed moduli: those of the curl transform with the truth."""
    learner = Learner.from_data(sets[0])
    kind = learner.kind
    u, maps = turned(kind.name, sets[0].displacement, learner.maps, rng)
    assert not np.allclose(maps, learner.maps)
    off = [
        np.median(np.abs(kind.features(v, sets[0].poisson)[:, 12] - m[:, 0] - np.log(np.hypot(1, m[:, 1]))))
        for v, m in ((u, maps), (sets[0].displacement, learner.maps))
    ]
    assert off[0] == pytest.approx(off[1], rel=1e-3) and off[1] < 0.2


def test_a_mirror_turns_signs(rng):
    """A displacement along x at the left becomes one against x at the right."""
    u = rng.standard_normal((20, 6, 6, 1))
    seen, maps = turned("compression", u, u.transpose(0, 3, 1, 2), rng)
    mirrored = [i for i in range(20) if not np.allclose(seen[i], u[i])]
    assert 3 < len(mirrored) < 17
    assert all(np.allclose(seen[i], u[i, :, ::-1]) for i in mirrored)
    assert np.allclose(seen[..., 0], maps[:, 0])


def test_errors_are_those_of_moduli():
    truth = np.log(np.full((1, 1, 4, 4), 2e-3))
    lossy = np.concatenate([truth, np.full_like(truth, 0.1)], axis=1)
    found = lossy + np.array([np.log(1.1), 0.01]).reshape(1, 2, 1, 1)
    assert np.allclose(relative_errors(found, lossy), [[0.1, 1.1 * 1.1 - 1]])
    lossless = lossy * np.array([1, 0]).reshape(1, 2, 1, 1)
    assert np.isnan(relative_errors(found, lossless)[0, 1])


def test_scales_do_not_move_means():
    mean = torch.zeros(2, 2, 4, 4, requires_grad=True)
    scale = torch.zeros(2, 2, 4, 4, requires_grad=True)
    targets = torch.full((2, 2, 4, 4), 0.3)
    (from_both,) = torch.autograd.grad(objective(mean, scale, targets), mean, retain_graph=True)
    (from_wide,) = torch.autograd.grad(objective(mean, scale + 3, targets), mean)
    assert torch.equal(from_both, from_wide)
    exact = torch.log(torch.tensor(0.3))
    (at_error,) = torch.autograd.grad(objective(mean, exact.expand(2, 2, 4, 4).requires_grad_(), targets), mean)
    assert at_error.abs().max() > 0
    flat = exact.expand(2, 2, 4, 4).clone().requires_grad_()
    (of_scale,) = torch.autograd.grad(objective(mean.detach(), flat, targets), flat)
    assert of_scale.abs().max() < 1e-7  # least where the scale is the error


def test_a_tenth_less_is_worth_as_much_of_any_error():
    """Means learn equally for errors that differ by a factor of five; far below the floor they stop."""

    def slope(size: float):
        mean = torch.full((1, 2, 4, 4), size, requires_grad=True)
        scale, targets = torch.zeros(1, 2, 4, 4), torch.zeros(1, 2, 4, 4)
        (found,) = torch.autograd.grad(objective(mean, scale, targets), mean)
        return (found * size).sum().item()

    assert slope(0.1) == pytest.approx(slope(0.02), rel=0.4)
    assert slope(1e-5) < 0.05 * slope(0.02)


def test_normalisers_are_of_the_training_data(sets):
    learner = Learner.from_data(sets[0])
    model = Surrogate(small(learner.kind.channels, 2), learner.kind)
    features = learner.noisy_features(0.01)
    model.fit(features, learner.maps)
    assert np.allclose(model.centre.numpy().ravel(), features.mean(axis=(0, 2, 3)), atol=1e-5)
    assert np.allclose(model.width.numpy().ravel(), learner.maps.std(axis=(0, 2, 3)), rtol=1e-4, atol=1e-5)


def test_an_operator_corrects_a_first_estimate_by_the_spread_of_the_targets(sets):
    """First estimates: for waves the modulus by the curl, for compression the mean of the training."""
    learner = Learner.from_data(sets[0])
    kind, answers = learner.kind, len(learner.kind.answers)
    constant = torch.nn.Conv2d(kind.channels, 2 * answers, 1)
    torch.nn.init.zeros_(constant.weight)
    torch.nn.init.constant_(constant.bias, 0.5)
    model = Surrogate(constant, kind)
    features = learner.noisy_features(0.01)
    model.fit(features, learner.maps)
    middle, width = (f(learner.maps, axis=(0, 2, 3), keepdims=True) for f in (np.mean, np.std))
    first = features[:, list(kind.estimates)] if kind.name == "waves" else middle
    mean, scale = predict_batches(model, features)
    assert np.allclose(mean, first + 0.5 * width, atol=1e-4)
    assert np.allclose(scale, np.exp(0.5) * width, rtol=1e-3)


def test_a_stopped_training_goes_on_as_if_never_stopped(sets, tmp_path):
    settings = Settings(epochs=3, batch=4)
    through = train(small, *sets, tmp_path / "through", settings)

    class Stop(Exception):
        pass

    def stop(epoch: dict[str, float]) -> None:
        if epoch["epoch"] == 2:
            raise Stop

    with pytest.raises(Stop):
        train(small, *sets, tmp_path / "stopped", settings, stop)
    told: list[dict[str, float]] = []
    resumed = train(small, *sets, tmp_path / "stopped", settings, told.append)
    assert [each["epoch"] for each in told] == [3]
    features = Learner.from_data(sets[1]).noisy_features(0.0)
    assert np.array_equal(predict_batches(through, features)[0], predict_batches(resumed, features)[0])
    with pytest.raises(InputError, match=r"checkpoint\.pt"):
        train(small, *sets, tmp_path / "stopped", replace(settings, rate=1e-4))


def test_a_training_begins_with_the_weights_of_another(sets, tmp_path):
    """At a vanishing learning rate the weights equal those of the earlier training; its epochs do not count."""
    first = train(small, *sets, tmp_path / "first", Settings(epochs=2, batch=4))
    start, told = tmp_path / "first/checkpoint.pt", list[dict[str, float]]()
    second = train(small, *sets, tmp_path / "second", Settings(epochs=2, batch=4, rate=1e-9), told.append, start)
    features = Learner.from_data(sets[1]).noisy_features(0.0)
    assert np.allclose(predict_batches(first, features)[0], predict_batches(second, features)[0], atol=1e-5)
    saved = torch.load(tmp_path / "second/checkpoint.pt", weights_only=True)
    assert [each["epoch"] for each in saved["curve"]] == [1, 2, 3, 4] and told == saved["curve"][2:]
    assert saved["made_by"]["start"] == torch.load(start, weights_only=True)["made_by"]
    assert told[0]["objective"] != told[1]["objective"]
    made = list(_trainings(saved["made_by"]))[::-1]
    assert [each["rate"] for each in made] == [0.02, 1e-9] and "data" not in made[0]
    assert _command("waves", 1, {**made[1], "twice": ["sinc"]}) == (
        "python -m ngbrain.surrogate waves --epochs 2 --rate 1e-09 --seed 0 --twice sinc --start 0/waves/checkpoint.pt -o 1"
    )
    other = replace(sets[0], storage=1.1 * sets[0].storage, sha256="another")
    with pytest.raises(InputError, match="start"):
        train(small, other, sets[1], tmp_path / "third", start=start)


@pytest.mark.parametrize("sets", ["compression"], indirect=True)
def test_families_that_matter_most_are_seen_twice_as_often(sets, tmp_path, monkeypatch):
    both = replace(sets[0], family=np.arange(16) % 2, names=("sinc", "halves"))
    seen: list[np.ndarray] = []
    plain = Learner.draw_batch
    monkeypatch.setattr(Learner, "seen", lambda self, rows, *of: seen.append(rows) or plain(self, rows, *of))
    train(small, both, sets[1], tmp_path, Settings(epochs=30, batch=4, twice=("halves",)))
    share = np.mean(np.concatenate(seen[1:]) % 2)  # the first sight is for the normalisers
    assert share == pytest.approx(2 / 3, abs=0.05) and len(seen) == 1 + 30 * 4
    with pytest.raises(InputError, match="twice"):
        train(small, both, sets[1], tmp_path, Settings(twice=("halfs",)))


def test_an_operator_learns(sets, tmp_path):
    """Sixteen samples, until the error on four others is below that of the mean."""
    told: list[dict[str, float]] = []
    train(small, *sets, tmp_path, Settings(epochs=12, batch=4, rate=1e-2), told.append)
    assert told[-1]["objective"] < 0.7 * told[0]["objective"]


def test_data_of_two_modalities_are_refused(sets, tmp_path):
    other = replace(sets[1], modality="compression" if sets[1].modality == "waves" else "waves")
    with pytest.raises(InputError, match="validation"):
        train(small, sets[0], other, tmp_path)


def test_onnx_answers_as_torch_does(sets, tmp_path):
    pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    from ngbrain.surrogate.training.export import export

    kind = modality(sets[0].modality)
    learner = Learner.from_data(sets[0])
    model = Surrogate(small(kind.channels, 2 * len(kind.answers)), kind)
    features = learner.noisy_features(0.01)
    model.fit(features, learner.maps)
    export(model, tmp_path, kind.name, {"seed": 0})
    session = runtime.InferenceSession(str(tmp_path / f"{kind.name}.onnx"))
    mean, scale = session.run(None, {"features": features})
    ours = predict_batches(model, features)
    assert np.abs(mean - ours[0]).max() < 1e-5 * np.abs(ours[0]).max()
    assert np.allclose(np.exp(scale), ours[1], rtol=1e-4)
