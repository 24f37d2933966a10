"""A T1 made ready: registration, bias field, skull stripping, contrast.

- `bias_field`: The slow field that a receiving coil multiplies a scan with: estimated, and divided out where there is
  one.
- `brain`: The brain in any T1 of a head, with its skull or without.
- `check_brain`: Is a scan what it should be: one whole brain, taken out of its skull?.
- `contrast`: Is a picture of a head a T1? Which of fluid, grey and white matter is dark in it, and which is bright.
- `external_skull_strip`: Brain extraction by other programs, each an extra of its own: what may stand in for
  `ngbrain.image.preprocess.skull_strip.skull_strip`.
- `mni_landmarks`: Where parts of the brain lie in the MNI152 template: a few lines, tubes and ellipsoids, as markers
  for a search.
- `registration`: Affine registration of the template brain to a head, without a starting guess.
- `skull_strip`: The brain in a head with its skull: the template's place says where it is, grey values where it ends.
"""

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
