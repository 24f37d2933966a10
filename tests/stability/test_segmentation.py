"""Grey from white matter. Naive: three Gaussians, each with its variance, lose it. Ours: shared, with mixtures."""

import numpy as np
import pytest
from nilearn.datasets import load_mni152_gm_template, load_mni152_wm_template

from ngbrain.image import check_extracted, mni152
from ngbrain.image.segment import GREY, WHITE, segment
from ngbrain.image.volume import Volume


@pytest.fixture(scope="module")
def brain():
    """The T1, its mask, and where grey and white matter are in it."""
    scan = mni152()
    grey, white = (load(resolution=1).get_fdata() for load in (load_mni152_gm_template, load_mni152_wm_template))
    mask = check_extracted(scan)
    fluid = 1 - grey - white
    return scan.volume, mask, mask & (grey > np.maximum(fluid, white)), mask & (white > np.maximum(fluid, grey))


def dice(a, b):
    return 2 * (a & b).sum() / (a.sum() + b.sum())


def test_naive_three_gaussians_lose_white_matter(brain):
    volume, mask, grey, white = brain
    counts, edges = np.histogram(volume.data[mask], 225)
    y = (edges[1:] + edges[:-1]) / 2
    mean, sigma, weight = np.quantile(volume.data[mask], [0.05, 0.45, 0.85]), np.full(3, 0.08), np.ones(3) / 3

    def shares(y):
        p = weight / sigma * np.exp(-0.5 * ((y[..., None] - mean) / sigma) ** 2)
        return p / p.sum(axis=-1, keepdims=True)

    for _ in range(200):
        p = shares(y) * counts[:, None]
        weight, mean = p.sum(axis=0) / counts.sum(), p.T @ y / p.sum(axis=0)
        sigma = np.sqrt((p * (y[:, None] - mean) ** 2).sum(axis=0) / p.sum(axis=0))
    found = np.where(mask, 1 + shares(volume.data).argmax(axis=-1), 0)
    assert dice(found == GREY, grey) < 0.9
    assert dice(found == WHITE, white) < 0.85
    assert (found == WHITE).sum() / white.sum() < 0.75


def test_ours_keeps_it(brain):
    volume, mask, grey, white = brain
    labels = segment(volume, mask, np.eye(4)).volume.data
    assert dice(labels == GREY, grey) > 0.95  # deep nuclei as bright as white matter are grey here, not in the maps
    assert dice(labels == WHITE, white) > 0.95
    assert 0.95 < (labels == WHITE).sum() / white.sum() < 1.1


@pytest.fixture(scope="module")
def shaded(brain):
    """The T1 under a field that grows fourfold from bottom to top."""
    volume, mask, *_ = brain
    height = (np.arange(mask.shape[2]) - mask.shape[2] / 2) * 1e3 * volume.spacing[2]
    return Volume((volume.data * np.exp(0.7 * height / 80)).astype(np.float32), volume.affine)


@pytest.mark.slow
def test_naive_a_field_from_tissues_by_grey_values_alone_keeps_itself(brain, shaded, monkeypatch):
    """White matter in the dark part counts as grey, and justifies the field."""
    monkeypatch.setattr("ngbrain.image.segment._BY_PLACE", 0)
    labels = segment(shaded, brain[1], np.eye(4)).volume.data
    assert dice(labels == WHITE, brain[3]) < 0.74 and dice(labels == GREY, brain[2]) < 0.81


@pytest.mark.slow
def test_ours_starts_from_the_templates_tissues_too(brain, shaded):
    labels = segment(shaded, brain[1], np.eye(4)).volume.data
    assert dice(labels == WHITE, brain[3]) > 0.81 and dice(labels == GREY, brain[2]) > 0.83
