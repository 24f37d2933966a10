"""Common parts of all pages: a style that fits a phone, and the strain scale."""

from pathlib import Path

import numpy as np
import pytest

from ngbrain.report import pages
from ngbrain.report.pictures import style


@pytest.mark.parametrize("template", sorted(path.name for path in Path(pages.__file__).parent.glob("*.html")))
def test_no_template_is_wider_than_a_phone(template: str) -> None:
    """Tables scroll in their own container, pictures shrink, and every page includes the common style."""
    folder = Path(pages.__file__).parent
    text, style_sheet = (folder / template).read_text(), (folder / "_head.html").read_text()
    assert text.count("<table") == text.count('<div class="scroll"><table>') == text.count("</table></div>")
    assert ".scroll { overflow-x: auto; }" in style_sheet and "img { max-width: 100%; }" in style_sheet
    assert 'content="width=device-width' in style_sheet and "overflow-wrap: anywhere" in style_sheet
    if not template.startswith("_"):
        assert "<style" not in text and text.index('{% include "_head.html" %}') < text.index("<h1>")
        assert text.count("<!-- contents -->") == 1 and text.index("<!-- contents -->") < text.index("<h2")
        assert text.count('<div class="summary">') == 1 and text.index("<h1>") < text.index('<div class="summary">')


@pytest.mark.parametrize(
    ("strain", "top", "steps"), [(0.366, 0.4, 8), (0.0545, 0.06, 6), (0.24, 0.25, 10), (1.3, 1.4, 7), (0.004, 0.004, 8)]
)
def test_the_scale_of_strain_ends_at_the_first_round_step_that_reaches_the_data(
    strain: float, top: float, steps: int
) -> None:
    scale = style.StrainScale.up_to(strain)
    assert scale.edges == pytest.approx(np.linspace(0, top, steps + 1)) and len(set(np.diff(scale.edges).round(9))) == 1
    under, over = scale.cmap(scale.norm(0.999 * top)), scale.cmap(scale.norm(1.001 * top))
    assert under != over and scale.cmap(scale.norm(0.0)) != under
