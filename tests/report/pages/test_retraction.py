"""Required contents of the page of a retraction."""

import base64
import io
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import netgen.occ as occ
import ngsolve as ng
import numpy as np
import pytest

from ngbrain.errors import InputError, MissingExtra
from ngbrain.io import Frame, QuadraticGrid, save
from ngbrain.mesh import Cleft, Sizes, cleft_to, idealised_head
from ngbrain.report.pages import retraction, tables
from ngbrain.report.pages.retraction import Report, build
from ngbrain.report.pictures import animation, figures, style
from ngbrain.report.pictures.timeline import Run
from ngbrain.report.pictures.tool import tool_drawings
from ngbrain.report.render import renderer
from ngbrain.surgery import answers
from ngbrain.surgery.measures.dose_response import dose_response_points
from ngbrain.surgery.tools import HANDLE, Spatula
from ngbrain.surgery.uncertainty.error_budget import COMPUTED, FAILED, NOT_COMPUTED, UNDER_WAY
from ngbrain.surgery.uncertainty.verification_runs import HALF, MESH, MILLER, ORDER

KINDS = ("value", "mesh", "order", "step", "numerics", "material")
PROTOCOLS = ("continuous", "intermittent", "my own <way>")


GRID = 1.5e-4
"""Tolerance (m) of the corners of a drawn tool."""


def series(peak_mmHg: float, blade_mm: float) -> dict[str, list[float]]:  # noqa: N803
    t = np.array([0.0, 5.0, 10.0, 60.0, 300.0])
    shape = np.array([0, 0.4, 1, 0.6, 0.5])
    advance = np.array([0, 0.5, 1, 1, 1]) * blade_mm
    return {
        "t_s": t.tolist(),
        "opening_mm": (0.9 * advance).tolist(),
        "blade_mm": advance.tolist(),
        "pressure_mmHg": (peak_mmHg * shape).tolist(),
    }


def worth(value: float, mesh: float, order: float | None, step: float, numerics: float, *material: float) -> dict:
    """Error budget of one number."""
    return dict(zip(KINDS, (value, mesh, order, step, numerics, list(material)), strict=True))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result folder like that of `demo`, with a synthetic displacement."""
    folder = tmp_path_factory.mktemp("run")
    cleft = cleft_to(np.array([0.017, 0.0059, 0.0262]))
    grid = QuadraticGrid(idealised_head(cleft, sizes=Sizes(3e-3, 8e-3, 20e-3)))
    a, b, _ = cleft.coordinates(grid.points).T
    push = 5e-3 * np.exp(-np.hypot(a - 2e-3, b) / 1e-2) * (a > 1e-3)
    fields = {
        "displacement": (push[:, None] * cleft.across).astype(np.float32),
        "max_principal_strain": (50 * push).astype(np.float32),
    }
    still = {name: 0 * values for name, values in fields.items()}
    answers = {}
    for k, name in enumerate(PROTOCOLS):
        save(folder / f"{name}.vtkhdf", grid, [Frame(0.0, still), Frame(10.0, fields)], {"peak": {"t": 10.0}})
        answers[name] = {
            "peak_pressure_mmHg": 146.04 - 10 * k,
            "s_above_20_mmHg": 290.0,
            "longest_s_above_20_mmHg": 290.0 if k == 0 else 95.0,
            "dose_mmHg_min": 512.3 + k,
            "mps_p95": 0.231,
            "mps_p99": 0.36,
            "volume_mps_above": {"0.18": 2.1, "0.34": 0.41},
            "volume_mps_above_by_region_ml": {
                "cortex": {"0.18": 0.5, "0.34": 0.11},
                "white": {"0.18": 1.6 + (k == 2), "0.34": 0.3},
            },
            "beyond_fit_by_region_ml": {"cortex": 1.31, "white": 5.0},
            "von_mises_p95_kPa": 1.234,
            "min_perfusion_reserve_mmHg": -61.0,
            "pressure_held_15_min_mmHg": 21.5 if k == 0 else 0.0,
            "infarct_probability_95_at_held": [0.0042, 0.996] if k == 0 else None,
            "pressed_min": 16.0,
            "infarct_probability_95": [0.0042, 1.0] if k == 0 else [0.0, 1.0],
            "events_s": [0.0, 10.0, 300.0],
            "series": series(146.04 - 10 * k, 5.0),
        }
    geometry = {
        "target_m": cleft.target.tolist(),
        "out": cleft.out.tolist(),
        "across": cleft.across.tolist(),
        "depth_m": cleft.depth,
        "opening_m": cleft.opening,
        "width_m": cleft.width,
        "craniotomy_m": 0.04,
        "blade": {"width_m": 0.01, "tip_clearance_m": 0.004, "thickness_m": 0.002, "edge_radius_m": 0.001},
    }
    result = {
        "verb": "demo",
        "title": "A made-up head",
        "answers": answers,
        "geometry": geometry,
        "checks": {"reaction_balance": 3.2e-9, "dt_halving": 0.05, "gap_while_off_mm": None, "unheard_of": 1.5},
        "dose_response": dose_response_points(),
        "error_budget": {
            "peak_pressure_mmHg": worth(146.04, 7.1, None, 0.8, 7.9, 60.0, 146.04),
            "mps_p95": worth(0.231, 0.004, 0.012, 0.0, 0.016, 0.231, 0.231),
            "volume_mps_above/0.34": worth(0.41, 0.02, 0.03, 0.01, 0.06, 0.2, 0.5)
            | {"quantity": "volume_mps_above", "part": "0.34"},
            "volumes_ml/window": worth(1.0, 0.1, 0.1, 0.1, 0.3, 1.0, 1.0),
        },
        "material_uncertainty": {
            "peak_pressure_mmHg": {"as given": 146.04, "Miller alpha -4.7": 60.0},
            "beyond_fit_ml": 6.31,
            "modulus_near_site_Pa": 1500.0,
            "published_moduli_Pa": {"somebody1999:brain": 750.0},
            "published_rule": ["published for white matter", "recalled numbers are left out"],
            "published_left_out": {"nobody2000:brain": "recalled"},
            "published_mean_factor": 0.5,
            "published_sd_factor": 1.4,
            "tissue_near_site": "white",
            "peak_pressure_by_modulus_mmHg": {"somebody1999:brain": 73.02},
            "peak_pressure_range_mmHg": [60.0, 146.04],
            "discretisation_error_mmHg": {"half the time step": 7.3, "one order more": None},
        },
        "left_out": ["blood"],
        "later": {"keys": ["are", "no", "trouble"]},
    }
    (folder / "result.json").write_text(json.dumps(result))
    return folder


@pytest.fixture(scope="module")
def coarse() -> Iterator[None]:
    """Use a low resolution, for speed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(renderer, "SUPERSAMPLING", 1)
        patch.setattr(style, "DPI", 60)
        yield


@pytest.fixture(scope="module")
def page(made: Path, coarse: None) -> str:
    path = build(made)
    assert sorted(p.name for p in made.iterdir() if p.suffix == ".tmp") == []
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def alone(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Report:
    """A report of one protocol without verification runs."""
    folder = tmp_path_factory.mktemp("alone")
    (folder / "continuous.vtkhdf").write_bytes((made / "continuous.vtkhdf").read_bytes())
    result = json.loads((made / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps(without_checks(result, NOT_COMPUTED)))
    return Report(folder)


def without_checks(result: dict, status: str) -> dict:
    """The result of one protocol before any verification run."""
    of_peak = result["error_budget"]["peak_pressure_mmHg"] | dict.fromkeys(KINDS[1:5])
    return result | {
        "answers": {"continuous": result["answers"]["continuous"]},
        "comparison": answers.comparison({"continuous": None}, {}),
        "check_status": dict.fromkeys((ORDER, MESH, HALF, MILLER), status),
        "checks": {"reaction_balance": 3.2e-9, "dt_halving": None, "order_plus_one": None, "gap_while_off_mm": None},
        "error_budget": {"peak_pressure_mmHg": of_peak},
        "material_uncertainty": result["material_uncertainty"]
        | {"peak_pressure_mmHg": {"as given": 146.04, "Miller": None}},
        "warnings": ["initial shear moduli outside of <what is published>"],
    }


def words(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))


def test_one_protocol_is_compared_with_nothing(alone: Report, coarse: None) -> None:
    page = alone.write().read_text(encoding="utf-8")
    text = words(re.sub(r"(?s)<(style|script)>.*?</\1>", "", page))
    found = re.findall(
        r"(?i)compar\w*|equal\w*|lowest|highest|[▼▲]|side by side|all (?:ways|protocols)|other protocol\w*", text
    )
    assert found == [] and "Metric by metric" not in text
    assert "All numbers Metric Unit continuous Peak pressure under the blade mmHg 146 " in text
    assert "cortex 0.50 0.11 1.3" in text  # no column of protocols
    assert page.count('<img class="on"') == 1 and "The slice over time" in text


def test_what_is_not_computed_is_said_on_top_and_where_it_would_stand(alone: Report, coarse: None) -> None:
    text = words(alone.write().read_text(encoding="utf-8"))
    said = "Error estimates not computed: one order more, other elements, half steps, Miller&#39;s exponent."
    top, contents, rest = text.partition("Thresholds")
    assert said in top and contents and said in rest
    assert "Peak pressure under the blade mmHg 146 – – – – 60.0 to 146" in rest
    assert "Peak of one opening held to the end: 146 mmHg; other published tissue: 60.0 to 146 mmHg." in top
    assert "Change of the first peak with half the time step (relative) – less than 0.03 not computed" in rest
    assert "gap while the blade is off – mm greater than 0 does not apply" in rest
    assert "Miller not computed –" in rest
    assert top.index("Warning: initial shear moduli outside of &lt;what is published&gt;.") < top.index(
        "A simulation of"
    )


def test_a_page_is_written_again_as_checks_end_with_the_same_pictures(
    alone: Report, coarse: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = alone.folder / "result.json"
    result, first = json.loads(path.read_text()), alone.write().read_text(encoding="utf-8")
    monkeypatch.setattr("ngbrain.report.pictures.figures.head", lambda *_: pytest.fail("drawn again"))
    changed = without_checks(result | {"error_budget": result["error_budget"]}, UNDER_WAY)
    changed["check_status"][MESH], changed["check_status"][HALF] = COMPUTED, FAILED
    changed["error_budget"]["peak_pressure_mmHg"] |= {"mesh": 7.1, "numerics": 7.1}
    try:
        path.write_text(json.dumps(changed))
        page = alone.write().read_text(encoding="utf-8")
    finally:
        path.write_text(json.dumps(result))
    text = words(page)
    assert (
        "Checks under way when this page was written; they are added as they finish: one order more, Miller&#39;s"
        in text
    )
    assert "Checks that failed, so that their estimates are not known: half steps." in text
    assert "146 mmHg, errors: mesh 7.1 mmHg; other published tissue" in text
    assert "Change of the first peak with half the time step (relative) – less than 0.03 failed" in text
    pictures = r"data:image/(?:png|webp);base64,[^\"]*"
    assert re.findall(pictures, page) == re.findall(pictures, first)


def test_pictures_have_the_scale_of_the_largest_99th_percentile(
    made: Path, coarse: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    of = style.StrainScale.up_to
    monkeypatch.setattr(style.StrainScale, "up_to", lambda strain: asked.append(strain) or of(strain))
    result = json.loads((made / "result.json").read_text())
    result["answers"]["intermittent"]["mps_p99"] = 0.07
    retraction._pictures(made, result)
    assert asked == [0.36]  # once, for all pictures


def test_the_contents_lead_to_every_heading(page: str) -> None:
    contents = re.search(r"<nav.*?</nav>", page)
    assert contents and "<!-- contents -->" not in page
    links, places = (
        re.findall(r'href="#([^"]+)">(.*?)</a>', contents[0]),
        re.findall(r'<h2 id="([^"]+)">(.*?)</h2>', page),
    )
    assert links == places and len(dict(links)) == page.count("<h2") > 8
    assert {"risk", "error_budget"} < set(dict(links))


def test_the_page_stands_alone(page: str) -> None:
    assert not re.search(r"https?:|<link|<iframe|@import|url\(|fetch\(|import\(|XMLHttpRequest|WebSocket", page)
    assert not re.search(r"""\b(?:src|srcset|data|action)=["'](?!data:image/(?:png|webp);base64,)""", page)
    assert not re.search(r"""\bhref=["'](?!#)""", page)
    assert page.count("<script") == page.count("<script>") == 2  # of the scene and the player, which hold all they need
    assert "not for clinical decisions" in page


def test_time_series_and_the_scene_lie_beside_the_page(page: str, made: Path) -> None:
    result = json.loads((made / "result.json").read_text())
    for name, answer in result["answers"].items():
        table = np.genfromtxt(made / f"{name}_series.csv", delimiter=",", names=True)
        assert table["pressure_mmHg"].tolist() == answer["series"]["pressure_mmHg"]
        assert table["t_s"].tolist() == answer["series"]["t_s"]
    head = (made / "scene.glb").read_bytes()
    assert head[:4] == b"glTF" and int.from_bytes(head[8:12], "little") == len(head) and b"ventricles" in head


def test_all_pictures_decode_and_are_told_in_words(page: str) -> None:
    from matplotlib.image import imread

    found = re.findall(r'<img[^>]* alt="([^"]+)" src="data:image/(png|webp);base64,([^"]*)"', page)
    assert [kind for _, kind, _ in found] == ["png"] * 4 + ["webp"] * 2 + ["png"] and page.count("<img") == 7
    for _, kind, encoded in found:
        picture = imread(io.BytesIO(base64.b64decode(encoded, validate=True)), format=kind)
        assert picture.shape[1] == 60 * style.WIDTH * (animation.SHARE if kind == "webp" else 1)
        assert (picture[..., :3] / picture.max()).std() > 0.05  # something is on it


def test_the_viewer_starts_at_the_highest_pressure_and_does_not_play_by_itself(page: str) -> None:
    moments = re.findall(r'<img( class="on")? data-t="([^"]*)" alt="([^"]*)"', page)
    assert [(on, float(t)) for on, t, _ in moments] == [("", 0.0), (' class="on"', 10.0)]
    words = "10 s after first contact. continuous: 4.5 mm, 146 mmHg; intermittent: 4.5 mm, 136 mmHg; "
    words += "my own &lt;way&gt;: 4.5 mm, 126 mmHg"
    assert moments[1][2].endswith(words) and f"<output>{words}</output>" in page
    assert '<input type="range" min="0" max="1" value="1"' in page and ">Play</button>" in page
    assert page.count("setInterval") == 1 < page.index("setInterval") > page.index('button.addEventListener("click"')
    marks = re.findall(
        r'<i class="mark" data-left="([^"]*)" data-width="([^"]*)" data-end="([^"]*)" style="[^"]*left:([^"]*)%"', page
    )
    for left, width, end, at in marks:
        assert float(at) == pytest.approx(100 * (float(left) + float(width) * 10 / float(end)), abs=1e-3)
    assert [float(end) for _, _, end, _ in marks] == [60.0, 300.0]


def test_the_page_has_every_protocol_and_the_numbers(page: str) -> None:
    assert len(re.findall(r"Protocol \w+, \d+ (?:s|min)", page)) == 2
    text = words(page)
    for name in ("continuous", "intermittent", "my own &lt;way&gt;"):
        assert name in text
    assert "my own <way>" not in page
    assert "pressure under the blade reached at most 146 mmHg; it was above 20 mmHg for 4 min 50 s." in text
    assert "136 mmHg; it was above 20 mmHg for 4 min 50 s (at most 1 min 35 s without a break)" in text
    assert "Peak pressure under the blade mmHg 146 ▲ highest 136 126 ▼ lowest" in text
    assert "Dose: pressure × time mmHg min 512 513 514" in text  # equal within 0.5 %
    assert "lowest with my own &lt;way&gt; (my own &lt;way&gt; 126, intermittent 136, continuous 146 mmHg)" in text
    assert "Tissue with principal strain above 34 % ml 0.410" in text
    assert "6.31 ml of tissue went beyond" in text
    assert "Von Mises stress near the site, 95th percentile kPa 1.23 1.23 1.23" in text
    assert "Smallest perfusion reserve: MAP less the larger of pressure and ICP mmHg −61.0 −61.0 −61.0" in text
    assert "cortex continuous, intermittent, my own &lt;way&gt; 0.50 0.11 1.3 " in text
    assert "white continuous, intermittent 1.6 0.30 5.0 white my own &lt;way&gt; 2.6 0.30 5.0 " in text
    assert "continuous 21.5 mmHg 16 min at least as harmful as 20 mmHg (1 of 6 rats) intermittent none 16 min" in text
    assert "in rats, a constant pressure for 15 minutes" in text and "infarcts in 1 of 6 at 20 mmHg," in text
    assert not re.search(r"probability (of|at)|\d to \d+(\.\d)? %", text)  # six rats at 20 mmHg decide nothing
    assert "as stiff as somebody1999:brain 750 Pa 73.0" in text
    assert "shown here: published for white matter; recalled numbers are left out." in text
    assert "0.50 times as stiff as the scene's" in text and "Left out: nobody2000:brain (recalled)." in text
    assert "In all 60.0 to 146 mmHg. Discretisation error: half the time step changes the peak by 7.3 mmHg." in text
    assert "Peak pressure under the blade mmHg 146 7.1 – 0.80 7.9 60.0 to 146 " in text
    assert "95th percentile % 23.1 0.40 1.2 0 1.6 23.1 Tissue with" in text
    assert "above 34 % ml 0.410 0.020 0.030 0.010 0.060 0.200 to 0.500 " in text
    assert "3.2e-09 at most 1e-4 met" in text
    assert "0.0500 less than 0.03 NOT MET" in text
    assert "does not apply" in text
    assert "unheard of 1.50" in text


def test_pressures_are_drawn_as_doses_take_them() -> None:
    times = np.array([0.0, 5.0, 10.0, 12.0, 16.0, 24.0, 40.0])

    def exact(t: np.ndarray) -> np.ndarray:
        return np.where(t < 10, 3 * t, 10 + 20 * np.exp(-(t - 10) / 8))

    answer = {"series": {"t_s": times.tolist(), "pressure_mmHg": exact(times).tolist()}}
    _, straight = figures.course(answer, "pressure_mmHg")
    t, drawn = figures.course({**answer, "events_s": [0.0, 10.0, 40.0]}, "pressure_mmHg")
    assert set(times) <= set(t) and drawn.max() == 30 and drawn[-1] == pytest.approx(exact(times)[-1])
    assert np.array_equal(straight, np.interp(t, times, exact(times)))
    assert np.trapezoid(straight - exact(t), t) > 10 * abs(np.trapezoid(drawn - exact(t), t))


def test_below_20_mmHg_the_margin_is_said() -> None:
    ((_, text),) = tables.headlines({"continuous": {"peak_pressure_mmHg": 12.5, "margin_to_20_mmHg": 7.5}})
    assert text == "pressure under the blade reached at most 12.5 mmHg: never above 20 mmHg, with 7.50 mmHg to spare."


def test_the_blade_is_where_the_run_put_it(made: Path) -> None:
    result = json.loads((made / "result.json").read_text())
    found = Run.read(made, "continuous", result["geometry"], result["answers"]["continuous"]).peak()
    assert found.time == 10.0
    (shown,) = found.blades
    points, tris = shown.solid()
    at = found.cleft.coordinates(points)
    assert at.min(axis=0) == pytest.approx([5e-3, -5e-3, 4e-3], abs=GRID)
    assert at.max(axis=0) == pytest.approx([7e-3, 5e-3, found.cleft.depth + HANDLE], abs=GRID)
    assert abs(np.linalg.det((points - points.mean(axis=0))[tris]).sum()) > 0
    assert {"craniotomy", "skull", "wall_plus", "wall_minus", "floor"} <= set(found.outer)


@pytest.mark.parametrize(
    ("kind", "low", "high"),
    [
        (
            "two spatulas",
            [[2.5e-3, -5e-3, 4e-3], [-4.5e-3, -5e-3, 4e-3]],
            [[4.5e-3, 5e-3, 55e-3], [-2.5e-3, 5e-3, 55e-3]],
        ),
        ("tube", [[-4.5e-3, -4.5e-3, 4e-3]], [[4.5e-3, 4.5e-3, 55e-3]]),
    ],
)
def test_blades_share_the_way_and_a_tube_goes_half_of_it_on_each_side(kind: str, low: list, high: list) -> None:
    cleft = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 4e-3, 12e-3)
    sizes = {"kind": kind, "width_m": 0.01, "tip_clearance_m": 0.004, "thickness_m": 0.002, "edge_radius_m": 0.001}
    solids = [cleft.coordinates(one.solid()[0]) for one in tool_drawings(sizes, cleft, 5e-3)]
    assert [x.min(axis=0) for x in solids] == [pytest.approx(np.array(x), abs=GRID) for x in low]
    assert [x.max(axis=0) for x in solids] == [pytest.approx(np.array(x), abs=GRID) for x in high]


def test_a_blade_is_drawn_as_contact_sees_it() -> None:
    """For a curved face with a rounded tip, the drawn front is the rigid body's surface."""
    cleft = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 4e-3, 12e-3)
    sizes = {"width_m": 0.01, "tip_clearance_m": 0.004, "thickness_m": 0.002, "edge_radius_m": 0.001}
    (one,) = tool_drawings(sizes | {"face_radius_m": 0.04}, cleft, 1e-3)
    phi = Spatula(cleft, 0.01, 0.001, 0.004, 0.002, bend=0.04).distance(ng.CF(1e-3))
    mesh = ng.Mesh(occ.OCCGeometry(occ.Box((0, 0, 0), (1, 1, 1))).GenerateMesh(maxh=2.0))
    at = one.profile()
    front = at[(at[:, 0] > 1.1e-3) & (at[:, 1] < 50e-3)]
    off = [phi(ng.CF((float(a), 0, float(c))))(mesh(0.3, 0.3, 0.2)) for a, c in front]
    assert np.ptp(front[:, 0]) > 1.5e-3 and np.abs(off).max() < 5e-5, off


def test_without_matplotlib_it_says_what_to_install(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtra, match=r'pip install "ngbrain\[report\]"'):
        build(made)


def one_line(error: pytest.ExceptionInfo[InputError]) -> str:
    assert "\n" not in str(error.value)
    return str(error.value)


def test_a_missing_result_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        build(tmp_path)
    assert "result.json" in one_line(error)


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[1, 2]",
        '{"verb": "mesh", "quality": {}}',
        '{"answers": {}, "geometry": {}}',
        '{"answers": {"continuous": 3}, "geometry": {}}',
        '{"answers": {"continuous": {"series": {"t_s": []}}}, "geometry": {}}',
    ],
)
def test_a_foreign_result_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(InputError) as error:
        build(tmp_path)
    assert "result.json" in one_line(error)


@pytest.mark.parametrize("left_out", ["geometry", "run"])
def test_what_a_result_needs_beside_it(tmp_path: Path, made: Path, left_out: str) -> None:
    result = json.loads((made / "result.json").read_text())
    if left_out == "geometry":
        result["geometry"].pop("craniotomy_m")
        (tmp_path / "continuous.vtkhdf").write_bytes((made / "continuous.vtkhdf").read_bytes())
    (tmp_path / "result.json").write_text(json.dumps(result))
    with pytest.raises(InputError) as error:
        build(tmp_path)
    assert {"geometry": "craniotomy_m", "run": "continuous.vtkhdf"}[left_out] in one_line(error)
    assert not (tmp_path / "report.html").exists()
