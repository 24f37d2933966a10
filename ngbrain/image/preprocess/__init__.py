"""Preprocessing of a T1: registration, bias-field correction, skull stripping, contrast.

- `bias_field`: Bias-field estimation and correction (N4).
- `brain`: Brain mask of any T1 of a head, with or without skull.
- `check_brain`: Check that a scan is a complete, skull-stripped brain.
- `contrast`: Order and contrast of the grey values of fluid, grey and white matter.
- `external_skull_strip`: Skull stripping by other programs.
- `mni_landmarks`: Approximate anatomy of the MNI152 template.
- `registration`: Affine registration of the template brain to a head.
- `skull_strip`: Skull stripping by registration and grey values.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.image.preprocess import (
        bias_field,
        brain,
        check_brain,
        contrast,
        external_skull_strip,
        mni_landmarks,
        registration,
        skull_strip,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "bias_field",
    "brain",
    "check_brain",
    "contrast",
    "external_skull_strip",
    "mni_landmarks",
    "registration",
    "skull_strip",
]
