"""One kind of result: what it shows of itself, and that every result of the library is one."""

import json
from dataclasses import dataclass
from importlib import import_module
from pkgutil import walk_packages

import numpy as np
import pytest

import ngbrain
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.uncertainty.interval import CredibleInterval
from ngbrain.materials import NeoHooke
from ngbrain.materials.lab import Curve, fit
from ngbrain.result import Result, Status
from ngbrain.result_file import FileResult
from ngbrain.scene.result import SceneResult
from ngbrain.surgery.calibrate import Calibration

pytest.importorskip("matplotlib.figure", reason="matplotlib is not installed")


@dataclass(repr=False)
class Root(Result):
    x: float

    @property
    def value(self):
        return {"x": self.x, "field": np.array([1.0, 3.0])}

    @property
    def statistics(self):
        return {"back_substitutions": 2}


def test_a_line_a_card_and_a_file(tmp_path):
    root = Root(1.5, status=Status.CONVERGED, warnings=["near <0>"])
    assert repr(root) == "Root: x 1.5, field 2 in the mean of 2; converged; 2 back substitutions"
    assert "<td>converged</td>" in root._repr_html_() and "<li>near &lt;0&gt;</li>" in root._repr_html_()
    told = json.loads(root.save(tmp_path / "root.json").read_text())
    assert told["value"] == {"x": 1.5, "field": [1.0, 3.0]} and told["usable"] and told["warnings"] == ["near <0>"]
    assert [path.name for path in tmp_path.iterdir()] == ["root.json"]
    bands = Calibration(
        {"white": CredibleInterval(0.7, np.nan, 0.6, 0.8)}, None, None, MisfitLevel(9.0, 3.0), status=Status.CONVERGED
    )
    kept = json.loads(bands.save(tmp_path / "bands.json").read_text())["value"]
    assert kept == {"white": {"value": 0.7, "deviation": None, "low": 0.6, "high": 0.8}}
    assert repr(SceneResult({})) == "SceneResult: ; stopped before it converged; 0 s"
    with pytest.raises(NotImplementedError, match="Root has no plot"):
        root.plot()


def test_what_did_not_converge_is_not_usable_and_says_so():
    root = Root(1.5, status=Status.INVERTED)
    assert not root.usable and root.reasons == ["inverted element"]
    assert "Not usable: inverted element" in root._repr_html_() and "inverted element" in repr(root)


def test_every_result_of_the_library_says_what_its_value_is_and_what_was_counted():
    for module in walk_packages(ngbrain.__path__, "ngbrain."):
        if not module.name.endswith("__main__"):
            try:
                import_module(module.name)
            except ImportError:
                continue  # of an extra
    own = [each for each in _below(Result) if each.__module__.startswith("ngbrain")]
    names = {each.__name__ for each in own}
    assert names >= {
        "NewtonRecord",
        "PathRecord",
        "OptimisationResult",
        "ParameterEstimate",
        "Inversion",
        "Prediction",
        "Calibration",
        "Fit",
    }
    assert names >= {"SearchResult", "ProtocolResult", "SceneResult", "Segmentation", "LabelMesh", "HeadMesh"}
    for each in set(own) - {FileResult}:
        assert each.value is not Result.value and each.statistics is not Result.statistics, each
        assert each.__repr__ is Result.__repr__, each


def _below(kind):
    return [each for child in kind.__subclasses__() for each in (child, *_below(child))]


def test_results_of_a_fit_and_of_an_inversion_are_drawn():
    data = [Curve("shear", [0.1, 0.2, 0.3], [100.0, 201.0, 299.0])]
    law = fit(NeoHooke, data, {"mu": 500.0})
    assert repr(law).startswith("Fit: mu 999") and law.usable
    (axes,) = law.plot().axes
    measured, fitted = axes.lines
    assert measured.get_ydata() == pytest.approx([0.1, 0.201, 0.299])
    assert fitted.get_ydata() == pytest.approx([0.0999, 0.1998, 0.2997], rel=1e-3)
    inversion = Phantom.from_name("CV-G", 9).simulate_measurements(0.01).inversion()
    found = levenberg_marquardt(inversion.reduced, inversion.start)
    (axes,) = found.plot().axes
    drawn = axes.lines[0].get_ydata()
    assert len(drawn) == len(found.history) == found.statistics["iterations"]
    assert drawn[-1] == pytest.approx(found.history[-1].misfit / found.history[-1].expected)
