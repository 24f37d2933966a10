"""A picture of a scene before it is computed: `simulate --preview` and `Scene.plot`; of a problem: `Problem.plot`."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.solid.problem import Problem
from ngbrain.ladder.models.hierarchy import ModelHierarchy
from ngbrain.report.pages import preview as page
from ngbrain.report.pages.preview import Condition, Drawing, RigidBodyDrawing
from ngbrain.report.pictures.slices import ScanImage
from ngbrain.report.pictures.tool import TOOLS, tool_drawings
from ngbrain.scene import Contact, DisplacementBC, Scene
from ngbrain.surgery.head_models import Head, load_head
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.model_selection import LARGEST
from ngbrain.surgery.retraction import geometry
from ngbrain.units import to_ml

ROUND = 48
"""Number of points of a circle."""


def preview(scene: Scene | str | Path, folder: str | Path) -> Path:
    """Draw a scene: geometry, regions, conditions, cleft and tool, on three slices and in space. Nothing is solved.

    Parameters
    ----------
    scene : Scene or path
        What would be computed, or its file.
    folder : path
        Where `preview.html` goes, a page that opens alone.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        A scene that is not meaningful; all checks that precede a computation are made.

    Examples
    --------
    >>> import tempfile
    >>> from ngbrain.scene import DisplacementBC, Geometry, Quantity, Tissue
    >>> scene = Scene(
    ...     geometry=Geometry(kind="block", size=(0.06, 0.06, 0.04)),
    ...     tissues=[Tissue(mu=1000.0, poissons_ratio=0.3)],
    ...     displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-4))],
    ...     quantities=[Quantity(name="force", boundary="top")],
    ... )
    >>> preview(scene, tempfile.mkdtemp()).name
    'preview.html'
    """
    if not isinstance(scene, Scene):
        scene = Scene.from_toml(scene)
    drawing = draw(scene)
    Path(folder).mkdir(parents=True, exist_ok=True)
    return page.build(Path(folder) / "preview.html", drawing)


def plot_scene(scene: Scene) -> Any:
    """Plot the pictures of `preview` as one figure: three slices, and a view in space. A head is read and meshed for it.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        A scene that is not meaningful.
    MissingExtra
        matplotlib is not installed.
    """
    return page.plot_drawing(draw(scene))


def plot_problem(problem: Problem) -> Any:
    """Plot the mesh of a problem, its regions and its displacement conditions: three slices, and a view in space.

    Parameters
    ----------
    problem : Problem
        In space, with a mesh of tetrahedra.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    NotImplementedError
        A problem in the plane, or another mesh.
    MissingExtra
        matplotlib is not installed.
    """
    mesh = problem.mesh
    if mesh.dim != 3 or {len(element.vertices) for element in mesh.Elements()} != {4}:
        raise NotImplementedError("only meshes of tetrahedra have a picture")
    names, parts = sorted(set(mesh.GetBoundaries())), _parts(mesh)
    conditions = []
    for pattern, components in problem.supports.values.items():
        numbers = [each for each in components if each is not None]
        way = (
            np.array([0.0 if each is None else float(each) for each in components])
            if all(isinstance(each, int | float) for each in numbers)
            else None
        )
        moved = way is None or bool(np.any(way))
        conditions.append(Condition("moved" if moved else "fixed", pattern, _matching(pattern, names), way))
    middle = (parts["points"].min(axis=0) + parts["points"].max(axis=0)) / 2
    return page.plot_drawing(Drawing("", **parts, focus=middle, head=False, conditions=conditions))


def draw(scene: Scene) -> Drawing:
    """Everything that is drawn of a scene; raises `InputError` for one that is not meaningful."""
    return _operation(scene) if scene.is_operation else _body(scene)


def _body(scene: Scene) -> Drawing:
    """A body under loads, on its coarsest elements; making the problem checks its conditions."""
    hierarchy = ModelHierarchy(scene)
    model = {"mesh": "0", "order": "1", "strain": "finite", "pressure": "none", "space": "solid"}
    if scene.time.frequency is None:
        hierarchy.static(model, scene.time.end)
    mesh = hierarchy.mesh(model)
    names = sorted(set(mesh.GetBoundaries()))
    conditions = [_displacement(bc, names, scene) for bc in scene.displacement_bcs]
    for traction in scene.tractions:
        numbers = [each if isinstance(each, float) else math.nan for each in traction.value]
        way = None if np.isnan(numbers).any() else np.array(numbers)
        words = f"{_listed(traction.toml_value('value'))} Pa"
        conditions.append(Condition("traction", words, _matching(traction.boundary, names), way))
    for pressure in scene.pressures:
        words = f"{pressure.toml_value('value')} Pa, into the body"
        conditions.append(Condition("pressure", words, _matching(pressure.boundary, names)))
    for body in scene.contacts:
        words = f"{body.shape} that moves by {_listed(body.toml_value('travel'))} mm, friction {body.friction:g}"
        conditions.append(Condition("contact", words, _matching(body.boundary, names)))
    solids = [_rigid(body, hierarchy.longest, scene) for body in scene.contacts]
    points = [quantity.point for quantity in scene.quantities if quantity.point]
    parts = _parts(mesh)
    focus = np.array(points[0]) if points else (parts["points"].min(axis=0) + parts["points"].max(axis=0)) / 2
    head = scene.geometry.is_head
    image = _image(load_head(scene.geometry, scene.mesh.meshing_route)) if head else None
    return Drawing(
        scene.title, **parts, focus=focus, head=head, conditions=conditions, solids=solids, image=image,
        tables=_tables(scene, mesh, conditions), warnings=scene.warnings,
    )  # fmt: skip


def _operation(scene: Scene) -> Drawing:
    """An operation, on a coarse mesh that takes seconds, or on its own mesh where no coarse one is possible."""
    head, coarse = load_head(scene.geometry, scene.mesh.meshing_route), True
    try:
        model = RetractionModel.from_scene(replace(scene, mesh=scene.mesh.with_minimum(LARGEST)), head)
    except InputError:  # whatever else is wrong is so again
        model, coarse = RetractionModel.from_scene(scene, head), False
    model.materials(2)
    names = sorted(set(model.mesh.GetBoundaries()))
    conditions = [
        Condition("fixed", "fixed", tuple(model.fixed.split("|"))) if model.fixed else None,
        Condition("sliding", "slides along a fixed surface", tuple(model.sliding.split("|")))
        if model.sliding
        else None,
        Condition(
            "walls of the cleft", "the wall that the tool pushes, and the opposite one", _matching("wall_.*", names)
        ),
    ]
    made, cleft = geometry(model)["blade"], model.cleft
    at, end = (tool_drawings(made, cleft, way) for way in (0.0, scene.tool.travel))
    solids = []
    for first, last in zip(at, end, strict=True):
        points, triangles = first.solid()
        solids.append(RigidBodyDrawing(TOOLS[scene.tool.kind], points, triangles, last.solid()))
    image = _image(model.head)
    found = [each for each in conditions if each is not None]
    return Drawing(
        scene.title, **_parts(model.mesh), focus=cleft.target, head=True, conditions=found, solids=solids, image=image,
        coarse=coarse, tables=_tables(scene, model.mesh, found), warnings=scene.warnings,
    )  # fmt: skip


def _image(head: Head) -> ScanImage | None:
    """The scan of a head, if there is one."""
    found = head.pictures()
    if not found:
        return None
    return ScanImage(found["t1"], found["labels"], found["origin_m"].astype(float), float(found["spacing_m"]))


def _parts(mesh: ngs.Mesh) -> dict[str, Any]:
    """Points, tetrahedra, regions and faces, as copies that outlive the mesh."""
    made = mesh.ngmesh
    solids, sides = made.Elements3D().NumPy(), made.Elements2D().NumPy()
    names = mesh.GetMaterials()
    region = np.array([names[index - 1] for index in solids["index"].tolist()])
    triangles, numbers = sides["nodes"][:, :3].astype(int) - 1, sides["index"].copy()
    labels = mesh.GetBoundaries()
    faces = {
        name: np.concatenate([triangles[numbers == i + 1] for i, each in enumerate(labels) if each == name])
        for name in sorted(set(labels))
    }
    tets = solids["nodes"][:, :4].astype(int) - 1
    return {"points": np.array(made.Coordinates()), "tets": tets, "region": region, "faces": faces}


def _matching(pattern: str, names: Sequence[str]) -> tuple[str, ...]:
    return tuple(name for name in names if re.fullmatch(pattern, name))


def _displacement(bc: DisplacementBC, names: Sequence[str], scene: Scene) -> Condition:
    mine = _matching(bc.boundary, names)
    along = "" if bc.components == "xyz" else f" along {', '.join(bc.components)}"
    if bc.rotation is not None:
        about = f"({_listed(bc.axis or ())}) through ({_listed(bc.toml_value('centre') or (0, 0, 0))}) mm"
        words = f"rotated by {bc.toml_value('rotation')}° about {about}"
        return Condition("rotated", words, mine)
    if bc.contact == "sliding":
        return Condition("sliding", "slides along a fixed surface", mine)
    if not any(bc.value):
        return Condition("fixed", f"fixed{along}", mine)
    way = bc.displacement([np.zeros(1)] * 3, scene.time.end, 1.0) if bc.is_even else None
    moved = None if way is None else np.array([float(each) for each in way])
    face = ", by a face along which it slides" if bc.contact == "frictionless" else ""
    return Condition("moved", f"moved by {_listed(bc.toml_value('value'))} mm{along}{face}", mine, moved)


def _rigid(body: Contact, long: float, scene: Scene) -> RigidBodyDrawing:
    """A ball, or a part of a cylinder or plane."""
    middle, r = np.array(body.point), body.radius or 0.0
    angle = np.linspace(0, 2 * np.pi, ROUND, endpoint=False)
    if body.shape == "ball":
        heights = np.linspace(-np.pi / 2, np.pi / 2, ROUND // 2)
        rings = [
            np.column_stack([np.cos(h) * np.cos(angle), np.cos(h) * np.sin(angle), np.full(ROUND, np.sin(h))])
            for h in heights
        ]
        points = middle + r * np.concatenate(rings)
    else:
        axis = np.array(body.direction) / np.linalg.norm(np.array(body.direction))
        one = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        one, other = one / np.linalg.norm(one), np.cross(axis, one / np.linalg.norm(one))
        wide = 0.6 * long if body.shape == "plane" else r
        ring = wide * (np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * other)
        ends = (-0.03 * long, 0.0) if body.shape == "plane" else (-0.6 * long, 0.6 * long)
        rings = [ring + h * axis for h in ends]
        points = middle + np.concatenate(rings)
    tris = []
    for k in range(len(rings) - 1):
        i, j = np.arange(ROUND), (np.arange(ROUND) + 1) % ROUND
        a, b = k * ROUND, (k + 1) * ROUND
        tris += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    for start in (0, (len(rings) - 1) * ROUND):
        i = np.arange(2, ROUND)
        tris.append(start + np.column_stack([0 * i, i - 1, i]))
    end = np.array([float(each) for each in body.displacement(scene.time.end, 1.0)])
    return RigidBodyDrawing(body.shape, points, np.concatenate(tris), (points + end, np.concatenate(tris)))


def _listed(values: Any) -> str:
    return ", ".join(f"{each:g}" if isinstance(each, (int, float)) else str(each) for each in values)


def _tables(scene: Scene, mesh: ngs.Mesh, conditions: Sequence[Condition]) -> dict[str, list[tuple[str, ...]]]:
    """Tissues, regions, conditions, tool, times and requested quantities."""
    regions = list[tuple[str, ...]]()
    for tissue in scene.tissues:
        name = tissue.material if isinstance(tissue.material, str) else type(tissue.law().equilibrium).__name__
        relaxes = "relaxes" if tissue.law().branches else "elastic"
        swells = f", swells by {100 * tissue.swelling:g} %" if tissue.swelling else ""
        regions.append((tissue.region, f"{name}, initial modulus {tissue.initial_modulus:.4g} Pa{swells}", relaxes))
    volumes = {name: to_ml(ngs.Integrate(ngs.CF(1) * ngs.dx(name), mesh)) for name in sorted(set(mesh.GetMaterials()))}
    found: dict[str, list[tuple[str, ...]]] = {
        "Tissues": regions,
        "Regions of the mesh": [(name, f"{volume:.4g} ml") for name, volume in volumes.items()],
        "Boundary conditions and loads": [
            (", ".join(each.boundaries) or "no boundary", each.words) for each in conditions
        ],
    }
    if scene.gravity:
        before = scene.gravity.imaged
        imaged = "" if before is None else f", imaged in {_listed(before)} m/s²"
        found["Boundary conditions and loads"].append(
            ("everywhere", f"gravity {_listed(scene.gravity.acceleration)} m/s²{imaged}")
        )
    if scene.fluid:
        level = scene.fluid.toml_value("drained_to")
        drained = "nothing drained" if level is None else f"drained to {level:g} mm against gravity"
        found["Boundary conditions and loads"].append(
            ("the whole surface", f"fluid of {scene.fluid.density:g} kg/m³, {drained}")
        )
    if scene.is_operation:
        tool, cleft = scene.tool, scene.operated
        found["Operation"] = [
            ("cleft", f"{cleft.toml_value('width'):g} mm wide, {cleft.toml_value('gap'):g} mm between its walls"),
            ("craniotomy", f"{cleft.toml_value('craniotomy_diameter'):g} mm"),
            ("tool", f"{tool.kind}, {tool.toml_value('width'):g} mm wide, travels {tool.toml_value('travel'):g} mm"),
            *((f"protocol {each.name}", each.kind) for each in scene.protocols),
        ]
    time = scene.time
    wave = f"{time.frequency:g} Hz" if time.frequency else f"loads grow in {time.ramp:g} s, until {time.end:g} s"
    found["Time and quantities"] = [
        ("time", wave),
        *((quantity.label, f"tolerance {100 * quantity.tolerance:g} %") for quantity in scene.quantities),
    ]
    return found
