"""From a run's record to the answers: units, sums over regions, material uncertainty."""

from dataclasses import replace
from types import SimpleNamespace as Namespace

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.materials import CATALOGUE
from ngbrain.mesh import Cleft
from ngbrain.result import Status
from ngbrain.scene import Patient, Protocol, Scene, Tissue
from ngbrain.surgery.answers import DENSITY, answer, comparison, model_limitations, scale_moduli
from ngbrain.surgery.measures.observer import StepRecord
from ngbrain.surgery.measures.sampling import MeasureStatistics, TissuePart
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocol_run import Peak, ProtocolResult
from ngbrain.surgery.uncertainty.material_uncertainty import comparable_moduli, compute_material_uncertainty
from ngbrain.units import mmHg

T = np.array([0.0, 10.0, 1000.0])
PEAK = Peak(
    t=10.0,
    mps=MeasureStatistics(10.0, 0.01, 0.07, 0.12, 0.21),
    oss=MeasureStatistics(10.0, 0.02, 0.12, 0.17, 0.22),
    volume_mps_above={"0.14": {"grey": 0.2, "white": 0.3}, "0.18": {"grey": 0.05, "white": 0.0}},
    beyond_fit={"grey": 1.0, "white": 3.0},
    creased={"grey": 0.25, "white": 0.5},
    tissue={"grey": 400.0, "white": 600.0},
    near={"grey": 10.0, "white": 30.0},
    volume={"window": 0.0},
)
LARGEST = {
    "von_mises": MeasureStatistics(10.0, 30.0, 400.0, 1100.0, 2200.0),
    "rate": MeasureStatistics(5.0, 0.002, 0.007, 0.011, 0.018),
}


def run(pressure_mmHg, way=5e-3):  # noqa: N803
    rows = {name: np.zeros(len(T)) for name in StepRecord.__annotations__}
    rows["advance"] = way * (T > 0)
    rows |= {"t": T, "pressure": mmHg(np.array(pressure_mmHg)), "centre_pressure": mmHg(np.array([0.0, 12.0, 5.0]))}
    return ProtocolResult(rows, tuple(T), PEAK, LARGEST, 990.0, 2, 0, 5, 3, status=Status.CONVERGED)


def test_a_run_says_its_peaks_and_what_it_took():
    found = run([0.0, 34.0, 24.0])
    assert found.value == pytest.approx({"peak_pressure_mmHg": 34.0, "peak_force_N": 0.0})
    assert found.usable and repr(found).startswith("ProtocolResult: peak_pressure_mmHg 34, ")
    assert "2 time steps; 0 rejected; 5 Newton iterations; 3 factorisations" in repr(found)
    assert found.plot().axes[0].lines[0].get_ydata() == pytest.approx([0.0, 34.0, 24.0])


def test_an_answer_in_the_units_of_its_keys():
    found = answer(run([0.0, 34.0, 24.0]), Patient(mean_arterial_pressure=40.0, intracranial_pressure=5.0))
    assert found["peak_centre_pressure_mmHg"] == pytest.approx(12.0)
    assert found["series"]["centre_pressure_mmHg"] == pytest.approx([0.0, 12.0, 5.0])
    assert (found["von_mises_p95_kPa"], found["von_mises_max_over_0_5_ml_kPa"]) == pytest.approx((0.4, 2.2))
    assert (found["strain_rate_p99_per_s"], found["strain_rate_peak_at_s"]) == (0.011, 5.0)
    assert (found["mps_p50"], found["oss_p95"], found["mps_max_over_0_5_ml"]) == (0.01, 0.12, 0.21)
    assert found["volume_mps_above"] == {"0.14": 0.5, "0.18": 0.05} and found["beyond_fit_ml"] == 4.0
    assert found["compressed_by_35_percent_ml"] == 0.75
    assert found["volume_mps_above_by_region_ml"]["grey"] == {"0.14": 0.2, "0.18": 0.05}
    assert found["beyond_fit_by_region_ml"]["white"] == 3.0
    assert found["min_perfusion_reserve_mmHg"] == pytest.approx(6.0)
    assert found["s_perfusion_below_10_mmHg"] > 300
    assert found["pressure_held_15_min_mmHg"] == pytest.approx(24 + 10 * (1000 - 865) / 990, abs=0.3)
    assert 0 < found["infarct_probability_95"][0] < 0.01 and found["infarct_probability_95"][1] == 1.0


def test_stiffer_tissue_presses_more_and_longer_and_strains_as_much():
    patient = Patient(mean_arterial_pressure=40.0)
    soft = answer(run([0.0, 20.0, 15.0]), patient)
    found, real = scale_moduli(soft, 2.0, patient), answer(run([0.0, 40.0, 30.0]), patient)
    assert soft["s_above_20_mmHg"] == 0 and real["s_above_20_mmHg"] > 900
    for key in (
        "s_above_20_mmHg",
        "peak_pressure_mmHg",
        "dose_mmHg_min",
        "margin_to_20_mmHg",
        "min_perfusion_reserve_mmHg",
        "mps_p95",
    ):
        assert found[key] == pytest.approx(real[key]), key
    for key in ("peak_centre_pressure_mmHg", "von_mises_p95_kPa", "von_mises_max_over_0_5_ml_kPa"):
        assert found[key] == pytest.approx(2 * soft[key]) and soft[key] > 0, key
    assert found["von_mises_peak_at_s"] == soft["von_mises_peak_at_s"]


def test_only_equal_openings_are_compared_at_equal_work():
    def compared(way):
        runs = {"continuous": run([0.0, 30.0, 20.0]), "intermittent": run([0.0, 30.0, 10.0], way)}
        return comparison(runs, {name: answer(one, Patient()) for name, one in runs.items()})

    fair, unfair = compared(5e-3), compared(2.1e-3)
    assert "dose_at_equal_working_time_mmHg_min" in fair and "Not at equal" not in " ".join(fair["findings"])
    assert "dose_at_equal_working_time_mmHg_min" not in unfair
    assert unfair["findings"][0] == "Openings differ: travel of the blade (mm) intermittent 2.1, continuous 5."


def test_without_a_patient_no_perfusion():
    assert not [key for key in answer(run([0.0, 30.0, 20.0]), Patient()) if "perfusion" in key]


def band(**errors):
    parts = {"grey": TissuePart(ngs.CF(1), (0.9, 1.1), 2400.0), "white": TissuePart(ngs.CF(1), (0.7, 1.2), 1200.0)}
    white = Tissue(region="white", material="griffiths2024:white_matter")
    model = Namespace(
        parts=lambda: parts, scene=Scene.shipped("idealised_fast"), tissue=lambda name: {"white": white}[name]
    )
    runs = {"soft": run([0.0, 30.0, 20.0]), "hard": run([0.0, 50.0, 20.0])}
    return compute_material_uncertainty(model, runs, {"peak_pressure_mmHg": 18.0}, errors)


def test_the_band_is_the_peak_times_published_moduli_over_that_near_the_site():
    found = band(peak_pressure_mmHg={"step": 0.5, "order": 2.0, "mesh": None})
    own = found["modulus_near_site_Pa"]
    pressures, moduli = found["peak_pressure_by_modulus_mmHg"], found["published_moduli_Pa"]
    assert found["tissue_near_site"] == "white" and pressures["bennion2022:brain"] == pytest.approx(50 * 670 / own)
    assert pressures == pytest.approx({name: 50 * modulus / own for name, modulus in moduli.items()})
    assert pressures["griffiths2024:white_matter"] == pytest.approx(50.0)
    least, most = min(pressures.values()), max(pressures.values())
    assert found["peak_pressure_range_mmHg"] == pytest.approx([min(18.0, least), max(50.0, most)])
    errors = found["discretisation_error_mmHg"]
    assert errors == {"half the time step": 0.5, "one order more": 2.0, "another size of elements": None}
    assert found["fitted_strain_by_region"] == {"grey": 0.1, "white": 0.3} and found["fitted_strain"] == 0.1
    assert (found["beyond_fit_ml"], found["beyond_fit_percent"]) == pytest.approx((4.0, 0.4))


def test_a_check_that_failed_leaves_its_error_out():
    assert set(band()["discretisation_error_mmHg"].values()) == {None}


def test_like_constants_are_named_and_the_others_left_out_for_a_reason():
    """Every entry for white matter or the whole brain is included or excluded by the stated rule."""
    tissue = Tissue(region="white", material="griffiths2024:white_matter")
    found = comparable_moduli("white", tissue, 10.0)
    wanted = {"griffiths2024:white_matter": 1.0, "griffiths2024:corpus_callosum": 1.0, "bennion2022:brain": 1.0}
    wanted |= {"budday2017:corona_radiata": 0.5, "budday2017:corpus_callosum": 0.5}
    assert found.weights == wanted and found.moduli.keys() == wanted.keys()
    of_region = {"brain", "white_matter", "corona_radiata", "corpus_callosum"}
    assert {*found.moduli, *found.left_out} == {name for name, each in CATALOGUE.items() if each.region in of_region}
    assert not set(found.moduli) & set(found.left_out)
    for name, why in (
        ("miller2002:brain", "of swine, not human"),
        ("budday2017:corona_radiata:gent:tension", "of tension alone"),
        ("franceschini2006:brain", "of a drained skeleton"),
        ("laksari2012:brain", "of bovine, not human"),
    ):
        assert found.left_out[name] == why
    # Of Griffiths' branches a step of 10 s leaves β = (1 - e^-x)/x, x = 10 s μ/η, of each; Budday's law does not relax.
    x = 10 * np.array([970 / 2190, 250 / 299790])
    assert found.modulus == pytest.approx(160 + np.array([970, 250]) @ ((1 - np.exp(-x)) / x), rel=1e-6)
    assert found.moduli["budday2017:corona_radiata"] == 624.0 and found.factors["griffiths2024:white_matter"] == 1.0
    logs = np.log([found.factors[name] for name in wanted])
    assert found.spread[0] == pytest.approx(np.exp(np.average(logs, weights=list(wanted.values()))))
    assert any("has the weight 0.5" in each for each in found.rule) and any(
        "white matter" in each for each in found.rule
    )
    swine = comparable_moduli("white", Tissue(region="white", material="miller2002:brain"), 0.1)
    assert swine.left_out["miller2002:brain"] == "recalled" and not swine.moduli and swine.spread == (1.0, 1.0)
    bovine = Tissue(region="x", material="laksari2012:brain")
    assert comparable_moduli("x", bovine, 0.1).left_out["laksari2012:brain"] == "of compression alone"
    small = comparable_moduli("cortex", Tissue(region="cortex", material="bennion2022:brain"), 10.0)
    assert "budday2017:cortex" in small.moduli and "griffiths2024:white_matter" not in {*small.moduli, *small.left_out}
    hard = comparable_moduli("x", Tissue(region="x", material="mcelhaney1970:skull"), 10.0)
    assert not hard.moduli and hard.left_out["griffiths2024:cortex"] == "measured to 10 % strain"
    far = comparable_moduli("grey", Tissue(region="grey", material="franceschini2006:brain"), 10.0)
    assert (
        far.moduli
        and comparable_moduli("grey", Tissue(region="grey", mu=500.0), 10.0).moduli.keys() == far.moduli.keys()
    )


def made(ramp, *more, friction=0.0):
    """A model with a blade travel of 5 mm in `ramp` s, `more` protocols, a brain 0.15 m wide, shear-wave speeds of 2 and 5 m/s."""
    mesh = ngs.Mesh(occ.OCCGeometry(occ.Box((0, 0, 0), (0.15, 0.1, 0.1))).GenerateMesh(maxh=0.1))
    axes = (np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    scene = Scene.shipped("idealised_fast")
    scene = replace(
        scene,
        protocols=(Protocol(kind="continuous"), *more),
        tools=(replace(scene.tool, travel=5e-3, friction=friction),),
        time=replace(scene.time, ramp=ramp, end=100.0),
    )
    parts = {"soft": TissuePart(None, (0.9, 1.1), 4 * DENSITY), "stiff": TissuePart(None, (0.9, 1.1), 25 * DENSITY)}
    cleft = Cleft(np.zeros(3), *axes, 0.03, 4e-3, 0.012)
    head = Namespace(left_out="sulci")
    return Namespace(
        scene=scene, head=head, mesh=mesh, cleft=cleft, program=RetractionModel.program, parts=lambda: parts
    )


def inertia(ramp, *more, **runs):
    """The sentence on inertia."""
    first, *others = model_limitations(made(ramp, *more), runs)
    assert others[-1] == "sulci" and not [text for text in others if "inertia" in text]
    return first


def test_what_is_said_of_inertia_is_the_scenes():
    """A wave of 2 m/s takes 0.075 s through 0.15 m."""
    assert inertia(10.0) == (
        "inertia: the blade moves at up to 0.5 mm/s, at which its 5 mm take 10 s, 133 times as long as a shear wave through the "
        "brain (150 mm at 2 m/s: 0.075 s)"
    )
    assert inertia(0.75).startswith(
        "inertia: the blade moves at up to 6.67 mm/s, at which its 5 mm take 0.75 s, 10 times"
    )
    fast = inertia(0.1)
    assert fast.startswith("inertia, which matters here: the blade moves at up to 50 mm/s") and "only 1.3 times" in fast


def test_of_a_blade_of_given_force_inertia_is_asked_where_it_went():
    force = Protocol(kind="force", force_gf=30.0)
    assert inertia(10.0, force, force=run([0.0, 30.0, 20.0])) == inertia(10.0)  # 5 mm in 10 s
    assert inertia(10.0, force, force=run([0.0, 30.0, 20.0], 0.1)).startswith(
        "inertia: the blade moves at up to 10 mm/s"
    )


def test_friction_is_left_out_where_there_is_none():
    without, rubs = (model_limitations(made(10.0, friction=value), {}) for value in (0.0, 0.1))
    assert [text for text in without if text not in rubs] == ["friction between blade and tissue"]
    assert set(rubs) < set(without)


def test_one_fast_piece_of_one_protocol_is_enough_for_inertia():
    """The fast piece is the release, 4 mm in 0.02 s."""
    pieces = {"times": (0.0, 20.0, 20.02, 100.0), "travel": (0.0, 4e-3, 0.0, 0.0)}
    text = inertia(10.0, Protocol(kind="program", name="sudden", **pieces))
    assert text.startswith(
        "inertia, which matters here: the blade moves at up to 200 mm/s, at which its 5 mm take 0.025 s"
    )
