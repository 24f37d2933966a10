"""A head with a cleft: invariants of the forces."""

import math
from dataclasses import replace
from types import SimpleNamespace as Namespace

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import ContactError
from ngbrain.forward.transient.step_control import ErrorControl, StepControl
from ngbrain.scene import Protocol as SceneProtocol
from ngbrain.scene import Scene, Tissue
from ngbrain.surgery import model as surgery_model
from ngbrain.surgery.measures.observer import Observer
from ngbrain.surgery.model import FURTHEST, RetractionModel
from ngbrain.surgery.protocol_run import ProtocolRun, to_columns
from ngbrain.surgery.protocols import ToolMotion
from ngbrain.threads import set_threads
from ngbrain.units import gf

PUSH = ToolMotion("push and let go", (0.0, 2.0, 6.0, 8.0), (0.0, 1e-3, 1e-3, -1e-3))


@pytest.mark.slow
def test_doubling_every_modulus_doubles_every_force():
    set_threads(1)
    scene = Scene.shipped("idealised_fast")
    twice = replace(scene, tissues=tuple(tissue.with_scale(2.0) for tissue in scene.tissues))
    model = RetractionModel.from_scene(scene)
    soft, stiff = (to_columns(ProtocolRun(replace(model, scene=s), PUSH, None).run().rows) for s in (scene, twice))
    assert soft["force"].max() > 0.1
    assert stiff["force"] == pytest.approx(2 * soft["force"], rel=1e-6, abs=1e-6 * soft["force"].max())


@pytest.mark.slow
def test_contact_is_as_hard_as_one_three_times_harder(monkeypatch):
    """Elastic, 4 mm opening, coarse elements: little penetration, and a larger penalty changes little."""
    set_threads(1)
    opening, rows = 4e-3, []
    for penalty in (surgery_model.PENALTY, 3 * surgery_model.PENALTY):
        monkeypatch.setattr(surgery_model, "PENALTY", penalty)
        rows.append(opened_elastic(opening))
    assert rows[0].depth < 0.008 * opening < -rows[0].gap < 0.024 * opening
    assert rows[0].energy_off < 2e-3
    assert rows[0].pressure == pytest.approx(rows[1].pressure, rel=0.02)


@pytest.mark.slow
def test_without_its_offset_contact_is_a_matter_of_the_penalty(monkeypatch):
    """With the penalty alone the blade penetrates, and the pressure is that of a smaller opening."""
    set_threads(1)
    opening, rows = 4e-3, []
    monkeypatch.setattr(surgery_model, "OFFSET_SHARE", 0.0)
    for penalty in (surgery_model.PENALTY, 3 * surgery_model.PENALTY):
        monkeypatch.setattr(surgery_model, "PENALTY", penalty)
        rows.append(opened_elastic(opening))
    assert rows[0].depth > 0.015 * opening and rows[0].pressure < 0.97 * rows[1].pressure


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_a_blade_of_30_gf_opens_the_cleft_and_creeps(tmp_path, friction):
    set_threads(1)
    scene = Scene.shipped("idealised_fast")
    scene = replace(
        scene,
        protocols=(SceneProtocol(kind="force", force_gf=30.0),),
        tools=(replace(scene.tool, friction=friction),),
        time=replace(scene.time, ramp=2.0, end=8.0),
    )
    model = RetractionModel.from_scene(scene)
    program = model.program(scene, scene.protocols[0])
    whole = ProtocolRun(model, program, None).run()
    rows = to_columns(whole.rows)
    t, way, opening = (rows[name] for name in ("t", "advance", "opening"))
    assert rows["force"] == pytest.approx(gf(30.0) * np.minimum(t / 2, 1), rel=1e-3)
    assert rows["net_reaction"] == pytest.approx(rows["force"], rel=1e-3) and rows["balance"].max() < 1e-4
    held = t >= 2
    assert held.sum() > 3 and np.all(np.diff(way[held]) > 0) and np.all(np.diff(opening[held]) > 0)
    assert way[held][-1] > 1.05 * way[held][0] > 1e-3
    rubbed, stored = rows["friction_work"][-1], rows["contact_energy"][-1] + rows["tissue_work"][-1]
    assert rubbed + stored == pytest.approx(rows["blade_work"][-1], rel=2e-3) and (rubbed > 0) == (friction > 0)
    ProtocolRun(model, program, tmp_path).run(until=3.0)
    again = to_columns(ProtocolRun(model, program, tmp_path, resume=True).run().rows)
    assert all(np.array_equal(again[name], rows[name]) for name in rows)


@pytest.mark.slow
def test_a_force_beyond_the_opening_is_one_error():
    set_threads(1)
    scene = Scene.shipped("idealised_fast")
    tool, shared = replace(scene.tool, travel=1e-3), replace(scene.time, ramp=2.0, end=8.0)
    scene = replace(scene, tools=(tool,), time=shared, protocols=(SceneProtocol(kind="force", force_gf=50.0),))
    model = RetractionModel.from_scene(scene)
    with pytest.raises(ContactError, match="beyond the limit of 1 mm"):
        ProtocolRun(model, model.program(scene, scene.protocols[0]), None).run()


@pytest.mark.slow
def test_friction_on_the_blade_raises_the_pressure():
    """Elastic, 4 mm opening, coarse elements: friction of 0.1 raises the pressure by 16 %, with the same energy balance."""
    set_threads(1)
    free, rubs = (opened_elastic(4e-3, friction) for friction in (0.0, 0.1))
    assert rubs.pressure == pytest.approx(1.156 * free.pressure, rel=0.02)
    assert free.rubbed == 0 < rubs.rubbed < 0.1 and rubs.energy_off < 2e-3


def opened_elastic(opening, friction=0.0):
    """The fast idealised head, opened by a distance with elastic tissue, and the record at that state."""
    scene = Scene.shipped("idealised_fast")
    scene = replace(scene, tools=(replace(scene.tool, travel=opening),))
    scene = replace(scene, tools=(replace(scene.tool, friction=friction),))
    model = RetractionModel.from_scene(scene)
    ramp = model.ramp("open")
    run = model.run(ramp, StepControl(scene.time.ramp / 10, first=0.05), model.elastic_materials(scene.time.ramp))
    observe, rows = Observer(run.problem, model.blades, model.fixed), []
    run.run(lambda body, at, record: rows.append(observe(at.t, ramp.value(at.t), record.min_det_F)))
    row = rows[-1]
    off = abs(row.blade_work - row.contact_energy - row.tissue_work - row.friction_work) / row.tissue_work_size
    rubbed = row.friction_work / row.blade_work
    return Namespace(gap=row.gap, depth=row.depth, pressure=row.pressure, energy_off=off, rubbed=rubbed)


def test_the_scene_chooses_the_steps():
    scene = Scene.shipped("idealised_fast")
    way = FURTHEST * scene.tool.travel
    assert way == pytest.approx(1.25e-3, rel=2e-6) and way > 1.25e-3
    scene = replace(scene, time=replace(scene.time, max_step_contact=2.0, max_step_hold=0.1, step_tolerance=1e-3))
    assert RetractionModel.control(Namespace(scene=scene)) == ErrorControl(
        1e-3, touch=0.1, longest=0.1, shortest=1e-3, pushing=2.0, max_travel=way
    )
    scene = replace(scene, time=replace(scene.time, max_step_contact=2.0, max_step_hold=100.0, step_tolerance=0.01))
    assert RetractionModel.control(Namespace(scene=scene)) == ErrorControl(
        0.01, touch=0.2, longest=100.0, shortest=2e-3, pushing=2.0, max_travel=way
    )


def test_parts_are_tissues_by_name_without_the_ventricles():
    low, high = occ.Box((0, 0, 0), (1, 1, 1)), occ.Box((0, 0, 1), (1, 1, 2))
    low.mat("brain"), high.mat("ventricles")
    mesh = ngs.Mesh(occ.OCCGeometry(occ.Glue([low, high])).GenerateMesh(maxh=1.0))
    left = ngs.IfPos(0.5 - ngs.x, 1.0, 0.0)
    head = Namespace(
        mixtures=lambda mesh, order: {"brain": {"grey": left, "white": 1.0 - left}, "ventricles": {"ventricles": 1.0}}
    )
    tissues = (
        Tissue(region="grey", material="griffiths2024:cortex"),
        Tissue(region="white", mu=700.0),
        Tissue(region="ventricle.*", mu=50.0),
    )
    parts = RetractionModel(replace(Scene.shipped("idealised_fast"), tissues=tissues), head, mesh, None, None).parts()
    assert [(name, part.fitted, part.modulus) for name, part in parts.items()] == [
        ("grey", (0.9, 1.1), 2380.0),
        ("white", (0.0, math.inf), 700.0),
    ]
    where = [[part.where(mesh(x, 0.5, z)) for part in parts.values()] for x, z in ((0.2, 0.5), (0.8, 0.5), (0.2, 1.5))]
    assert where == [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]
