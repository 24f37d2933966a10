"""Training samples by seed: waves, compression, complete files with their provenance."""

import h5py
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.surrogate.data import dataset
from ngbrain.surrogate.data.dataset import DataSet, generate, sample, solve_displacement


def test_waves_of_a_published_case():
    """CV-G in fourth order against the published bilinear elements, which converge with second order."""
    off = []
    for nodes in (41, 81):
        phantom = Phantom.from_name("CV-G", nodes)
        y, x = np.meshgrid(*2 * (np.linspace(0, 0.12, 201),), indexing="ij")
        truth = phantom.truth(x, y)
        u = solve_displacement(truth["storage"] + 1j * truth["loss"], 50.0, 0.3, {"top": (1e-3, 0)}, nodes)
        theirs = phantom.simulate_measurements().displacement.reshape(nodes, nodes, 2)
        off.append(np.linalg.norm(u - theirs) / np.linalg.norm(theirs))
    assert off[1] < 0.02 and off[0] / off[1] == pytest.approx(4, rel=0.1)


@pytest.mark.parametrize("poisson", [0.3, 0.4995])
def test_a_uniform_square_between_plates_is_strained_evenly_when_nothing_holds_its_sides(poisson):
    """Plane strain: ε_yy = -1 %, ε_xx = ν/(1-ν) 1 %, whatever the modulus."""
    u = solve_displacement(
        np.full((9, 9), 4e3), 0.0, poisson, {"top": (0, -4e-4)}, 9, {"x": "left", "y": "bottom|top"}, 0.04
    )
    x = np.linspace(0, 0.04, 9)
    assert np.allclose(u[..., 1], -0.01 * x[:, None], atol=1e-9)
    assert np.allclose(u[..., 0], 0.01 * poisson / (1 - poisson) * x, atol=1e-9)


@pytest.mark.one_thread
def test_samples_come_from_their_seed_and_splits_never_meet():
    one, same = (sample("compression", "sinc", 0, "test", 3, 11) for _ in range(2))
    assert np.array_equal(one.displacement, same.displacement)
    keys = [(0, "test", 4), (0, "train", 3), (0, "validation", 3), (1, "test", 3)]
    for seed, split, index in keys:
        assert not np.allclose(sample("compression", "sinc", seed, split, index, 11).storage, one.storage, rtol=1e-3)


def test_finer_points_are_those_of_the_same_sample():
    coarse, fine = (sample("waves", "inclusions", 0, "test", 0, n) for n in (26, 51))
    assert np.allclose(fine.displacement[::2, ::2], coarse.displacement, rtol=1e-6, atol=1e-12)
    assert np.allclose(fine.storage[::2, ::2], coarse.storage)


def test_a_file_says_what_is_in_it(tmp_path):
    path = tmp_path / "few.h5"
    generate(path, "waves", {"sinc": 2, "halves": 1}, "validation", seed=5, across=11)
    found = DataSet.read(path)
    assert (found.modality, found.split, found.names, len(found)) == ("waves", "validation", ("sinc", "halves"), 3)
    assert found.family.tolist() == [0, 0, 1]
    alone = sample("waves", "halves", 5, "validation", 0, 11)
    assert np.allclose(found.displacement[2], alone.displacement, rtol=1e-6)
    assert found.frequency[2] == alone.frequency and 30 <= alone.frequency <= 80
    with h5py.File(path) as file:
        assert file.attrs["seed"] == 5 and "version_ngsolve" in file.attrs
    assert [each.name for each in tmp_path.iterdir()] == ["few.h5"]


def test_changed_files_are_refused(tmp_path):
    path = tmp_path / "few.h5"
    generate(path, "compression", {"sinc": 1}, "test", across=11)
    with h5py.File(path, "r+") as file:
        file["storage"][0, 0, 0] *= 1.001
    with pytest.raises(InputError, match="sha256"):
        DataSet.read(path)
    with h5py.File(path, "w") as file:
        file["storage"] = np.ones(3)
    with pytest.raises(InputError, match=r"few\.h5: file is without"):
        DataSet.read(path)


@pytest.mark.parametrize(("modality", "split", "field"), [("wave", "test", "modality"), ("waves", "tests", "split")])
def test_names_that_are_none(modality, split, field):
    with pytest.raises(InputError, match=field):
        sample(modality, "sinc", 0, split, 0, 11)


def test_elements_are_fine_enough(monkeypatch):
    """The shortest waves with 1.5 times as many elements differ by a third of the operator's noise level."""
    random = np.random.default_rng(0)
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, 201),), indexing="ij")
    shear = 3e3 * dataset.family("tumour")(random, x, y) * (1 + 0.2j)
    coarse = solve_displacement(shear, 80.0, 0.3, {"top": (1e-3, 0)}, 26)
    monkeypatch.setattr(dataset, "CELLS", 24)
    dataset._square.cache_clear()
    fine = solve_displacement(shear, 80.0, 0.3, {"top": (1e-3, 0)}, 26)
    dataset._square.cache_clear()
    assert np.linalg.norm(coarse - fine) < 0.004 * np.linalg.norm(fine)
