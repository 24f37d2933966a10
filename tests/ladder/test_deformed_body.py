"""The file of the deformed body that a search leaves, and what the page shows of it."""

import numpy as np
import pytest

from ngbrain.io import load
from ngbrain.ladder.quantities import BODY
from ngbrain.report.pages import ladder as page
from ngbrain.scene import DisplacementBC, Geometry, Quantity, Scene, Tissue
from ngbrain.workflows.preview import draw
from ngbrain.workflows.simulate import simulate

SHORTER = 2e-3


def scene():
    """A block that is pressed."""
    ends = [DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -SHORTER))]
    return Scene(
        geometry=Geometry(kind="block", size=(0.06, 0.06, 0.04)),
        tissues=[Tissue(mu=1000.0, poissons_ratio=0.0)],  # a column of it shortens evenly
        displacement_bcs=ends,
        quantities=[Quantity(name="force", boundary="top", tolerance=0.5)],
    )


@pytest.mark.parametrize("strain", ["linear", "finite"])
def test_an_evenly_shortened_block(tmp_path, strain):
    result = simulate(scene(), tmp_path, model={"space": "solid", "strain": strain, "order": "1", "mesh": "0"})
    found = load(tmp_path / BODY)
    moved, largest = (found.frames[-1].point_data[name] for name in ("displacement", "max_principal_strain"))
    near = 1e-8 if strain == "linear" else 1e-4  # m; a neo-Hookean column also widens a little
    z = found.grid.points[:, 2]
    assert np.allclose(moved[:, 2], -SHORTER * (z - z.min()) / np.ptp(z), atol=near)
    assert np.abs(moved[:, :2]).max() < near and np.abs(largest).max() < 50 * near
    drawing = draw(scene())
    text = page.build(tmp_path / "report.html", result.to_dict(), drawing).read_text()
    assert (
        "deformed body" in text and "The undeformed body" in text and text.count("<img") == 3 and "body.vtkhdf" in text
    )
    (tmp_path / BODY).unlink()
    text = page.build(tmp_path / "report.html", result.to_dict(), drawing).read_text()
    assert "The deformed body is not drawn" in text and text.count("<img") == 2
