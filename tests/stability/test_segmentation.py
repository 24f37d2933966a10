"""Grey from white matter. Naive: three Gaussians, each with its variance, lose it. Ours: shared, with mixtures."""

import numpy as np
import pytest
from nilearn.datasets import load_mni152_gm_template, load_mni152_wm_template

from ngbrain.image import check_extracted, mni152
from ngbrain.image.preprocess import mni_landmarks
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.tissue_classes import GREY, WHITE, segment


@pytest.fixture(scope="module")
def brain():
    """The T1, its mask, where nuclei, as bright as white matter in its maps, are not, and where grey and white matter are."""
    scan = mni152()
    grey, white = (load(resolution=1).get_fdata() for load in (load_mni152_gm_template, load_mni152_wm_template))
    mask = check_extracted(scan)
    fluid, points = 1 - grey - white, 1e3 * scan.volume.to_world(np.argwhere(mask))
    seen = mask.copy()
    seen[mask] = np.min([nucleus.radius(points) for nucleus in mni_landmarks.NUCLEI.values()], axis=0) > 1.2
    return scan.volume, mask, seen, grey > np.maximum(fluid, white), white > np.maximum(fluid, grey)


def dice(found, truth, seen):
    return 2 * (found & truth & seen).sum() / ((found & seen).sum() + (truth & seen).sum())


def test_naive_three_gaussians_lose_white_matter(brain):
    volume, mask, seen, grey, white = brain
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
    assert dice(found == GREY, grey, seen) < 0.9
    assert dice(found == WHITE, white, seen) < 0.85
    assert (found == WHITE).sum() / (mask & white).sum() < 0.75


def test_ours_keeps_it(brain):
    volume, mask, seen, grey, white = brain
    labels = segment(volume, mask, np.eye(4)).volume.data
    assert dice(labels == GREY, grey, seen) > 0.952
    assert dice(labels == WHITE, white, seen) > 0.95
    assert 0.95 < (seen & (labels == WHITE)).sum() / (seen & white).sum() < 1.1


@pytest.fixture(scope="module")
def shaded(brain):
    """The T1 under a field that grows fourfold from bottom to top."""
    volume, mask, *_ = brain
    height = (np.arange(mask.shape[2]) - mask.shape[2] / 2) * 1e3 * volume.spacing[2]
    return Volume((volume.data * np.exp(0.7 * height / 80)).astype(np.float32), volume.affine)


@pytest.mark.slow
def test_naive_a_field_from_tissues_by_grey_values_alone_keeps_itself(brain, shaded, monkeypatch):
    """White matter in the dark part counts as grey, and justifies the field."""
    monkeypatch.setattr("ngbrain.image.segment.tissue_classes._BY_PLACE", 0)
    _, mask, seen, grey, white = brain
    labels = segment(shaded, mask, np.eye(4)).volume.data
    assert dice(labels == WHITE, white, seen) < 0.74 and dice(labels == GREY, grey, seen) < 0.81


@pytest.mark.slow
def test_ours_starts_from_the_templates_tissues_too(brain, shaded):
    _, mask, seen, grey, white = brain
    labels = segment(shaded, mask, np.eye(4)).volume.data
    assert dice(labels == WHITE, white, seen) > 0.81 and dice(labels == GREY, grey, seen) > 0.83


@pytest.fixture(scope="module")
def cerebellum(brain):
    volume, mask, *_ = brain
    points = 1e3 * volume.to_world(np.argwhere(mask))
    found = mask.copy()
    found[mask] = (points[:, 2] < mni_landmarks.tentorium(points) - 2) & (points[:, 1] < -46)
    return found


@pytest.fixture(scope="module")
def bright_neck(brain):
    """The T1 by a coil at the neck: the cerebellum's grey matter is as bright as the cerebrum's white."""
    volume, mask, *_ = brain
    height = 1e3 * volume.to_world(np.argwhere(np.ones(mask.shape, bool)))[:, 2].reshape(mask.shape)
    return Volume((volume.data * np.exp(0.45 / (1 + np.exp((height + 15) / 25)))).astype(np.float32), volume.affine)


@pytest.mark.slow
def test_naive_a_bright_cerebellum_is_white_matter(brain, bright_neck, cerebellum, monkeypatch):
    """The contrast is as large as it would be with the field gone (3.3 and 3.2): that does not tell."""
    monkeypatch.setattr("ngbrain.image.segment.tissue_classes._BY_PLACE", 0)
    _, mask, _, grey, white = brain
    labels = segment(bright_neck, mask, np.eye(4)).volume.data
    assert dice(labels == WHITE, white, cerebellum) < 0.5 and dice(labels == GREY, grey, cerebellum) < 0.8
    assert (cerebellum & (labels == WHITE)).sum() > 3 * (cerebellum & white).sum()


@pytest.mark.slow
def test_ours_keeps_white_matter_where_the_template_has_it(brain, bright_neck, cerebellum):
    _, mask, _, grey, white = brain
    labels = segment(bright_neck, mask, np.eye(4)).volume.data
    assert dice(labels == WHITE, white, cerebellum) > 0.9 and dice(labels == GREY, grey, cerebellum) > 0.97
