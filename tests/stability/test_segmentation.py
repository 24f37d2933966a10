"""Grey from white matter. Naive: three Gaussians, each with its variance, lose it. Ours: shared, with mixtures."""

import numpy as np
import pytest
from nilearn.datasets import load_mni152_gm_template, load_mni152_wm_template

from ngbrain.image import check_extracted, mni152
from ngbrain.image.segment import GREY, WHITE, segment


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
