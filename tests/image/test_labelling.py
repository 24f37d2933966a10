"""Warnings on labels with low contrast or unusual volumes."""

import warnings

import numpy as np
import pytest

from ngbrain.image.labelling import LEAST_CONTRAST, TissueWarning, _with_warnings
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.tissue_classes import CSF, GREY, VENTRICLE, WHITE


def brain(grey=600, white=500, ventricle=20):
    """Labels of so many ml, on voxels of 1 ml."""
    data = np.repeat([CSF, GREY, WHITE, VENTRICLE], [200, grey, white, ventricle]).astype(np.uint8)
    return Volume(data.reshape(-1, 1, 1), np.diag([1e-2, 1e-2, 1e-2, 1.0]))


def test_an_ordinary_brain_is_no_matter_for_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = _with_warnings(labels := brain(), LEAST_CONTRAST)
    assert found.volume is labels and found.labels.regions == ("csf", "grey", "white", "ventricles")
    assert found.usable and found.value == pytest.approx(
        {"csf": 200.0, "grey": 600.0, "white": 500.0, "ventricle": 20.0}
    )
    assert repr(found) == (
        "Segmentation: csf 200 ml, grey 600 ml, white 500 ml, ventricle 20 ml; converged; 3 spreads from grey to white"
    )
    assert [len(axes.images) for axes in found.plot().axes] == [1, 1, 1]


@pytest.mark.parametrize(
    "labels, contrast, said",
    [
        (brain(), 2.7, "grey and white matter differ by 2.7 times the spread"),
        (brain(ventricle=3), 6.0, "3.0 ml of ventricle found, where people have 7 to 150 ml"),
        (brain(grey=300), 6.0, "300.0 ml of grey found"),
        (brain(white=900), 6.0, "900.0 ml of white found"),
    ],
)
def test_warns_of_low_contrast_and_of_volumes_that_people_hardly_have(labels, contrast, said):
    with pytest.warns(TissueWarning, match=said):
        found = _with_warnings(labels, contrast)
    assert len(found.warnings) == 1 and said in found.warnings[0]
