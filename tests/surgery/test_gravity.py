"""An operation on a head that settles under gravity, a drained fluid and swelling before the tool touches it."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import BodyForce, FluidPressure
from ngbrain.scene import Fluid, Gravity, MeshSize, Scene
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocol_run import ProtocolRun

COARSE = MeshSize(wall=5e-3, craniotomy=14e-3, largest=36e-3)
SIDEWAYS, SUPINE = (-9.81, 0.0, 0.0), (0.0, -9.81, 0.0)


def loaded(**given):
    """The idealised head on its left side, its white matter swollen by 1 %, its ventricles full of fluid."""
    base = Scene.shipped("idealised_fast")
    changed = {"white": {"swelling": 0.01}, "ventricle.*": {"bulk_to_shear_ratio": 1000.0, "density": 1007.0}}
    tissues = tuple(replace(each, **changed.get(each.region, {})) for each in base.tissues)
    gravity = Gravity(acceleration=SIDEWAYS, imaged=SUPINE)
    time = replace(base.time, ramp=10.0, end=20.0)
    parts = {"tissues": tissues, "gravity": gravity, "fluid": Fluid(density=1007.0, drained_to=0.02)} | given
    return replace(base, mesh=COARSE, protocols=base.protocols[:1], time=time, **parts)


@pytest.fixture(scope="module")
def model():
    return RetractionModel.from_scene(loaded())


def test_loads_are_the_difference_to_those_in_the_scanner(model):
    weight, now, before = model.gravity_loads(2)
    assert isinstance(weight, BodyForce) and isinstance(now, FluidPressure)
    change = np.array(ngs.Integrate(weight.value, model.mesh))
    mass = ngs.Integrate(model.mesh.MaterialCF({"ventricle.*": 1007.0}, default=1040.0), model.mesh)
    assert change == pytest.approx(mass * (np.array(SIDEWAYS) - np.array(SUPINE)), rel=1e-9)
    assert (now.weight, now.level, now.drained, now.density) == (SIDEWAYS, 0.02, True, 1007.0)
    assert (before.weight, before.drained, before.density) == (SUPINE, False, -1007.0)
    assert {name: each.swelling for name, each in model.materials().items()}["white"] == 0.01


def test_derivatives_of_a_run_refuse_it(model):
    with pytest.raises(InputError, match="gravity is given; wanted: a scene without gravity and swelling"):
        model.check_rest()
    with pytest.raises(InputError, match=r"fluid.drained_to_mm is 200; wanted: a height within the body"):
        RetractionModel.from_scene(loaded(fluid=Fluid(density=1007.0, drained_to=0.2))).gravity_loads(2)


@pytest.mark.slow
def test_the_head_settles_before_the_tool_touches_it(model):
    run = ProtocolRun(model, model.program(model.scene, model.scene.protocols[0]), None)
    body = run.transient.problem
    assert run.transient.progress.t == 0 and body.factor.Get() == 1
    moved = np.array(ngs.Integrate(body.u, body.mesh)) / ngs.Integrate(ngs.CF(1), body.mesh)
    assert moved @ model.cleft.out > 1e-4 and body.min_gap() == pytest.approx(0, abs=1e-6)  # it swells out of the skull
    result = run.run().result()
    kept = sum(result.column(name)[-1] for name in ("contact_energy", "tissue_work", "friction_work"))
    assert abs(result.column("blade_work")[-1] - kept) < 0.05 * result.column("tissue_work_size")[-1]
    assert float((result.column("balance") * result.column("force")).max()) < 1e-3 * result.column("force").max()
    bare = RetractionModel(
        replace(model.scene, gravity=None, fluid=None, tissues=Scene.shipped("idealised_fast").tissues),
        model.head,
        model.mesh,
        model.cleft,
        model.blades,
    )
    alone = ProtocolRun(bare, bare.program(bare.scene, bare.scene.protocols[0]), None).run().result()
    assert result.value["peak_pressure_mmHg"] != pytest.approx(alone.value["peak_pressure_mmHg"], rel=1e-3)
