"""Meshes and surfaces of other programs through the command: the result, and options that do not apply."""

import json

import meshio
import numpy as np
import pytest
from phantoms import nested

from ngbrain.cli import main
from ngbrain.io import load
from ngbrain.io.exchange import write_mesh
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.quality import volumes_ml
from ngbrain.mesh.routes.hull import hull
from ngbrain.mesh.surface.mask_surface import contour


def test_a_mesh_of_gmsh_becomes_one_of_ours(tmp_path, capsys):
    made = hull(nested((20.0, 15.0, 8.0)), RadialSizeField(7e-3, 7e-3)).elements
    write_mesh(tmp_path / "head.msh", made)
    out = tmp_path / "out" / "head.vtkhdf"
    assert main(["mesh", str(tmp_path / "head.msh"), "--unit", "m", "-o", str(out)]) == 0
    result = json.loads(out.with_name("result.json").read_text())
    assert {name: r["volume_ml"] for name, r in result["regions"].items()} == pytest.approx(volumes_ml(made))
    assert result["route"] == "imported" and result["boundaries"] == ["skull", "ventricle_wall"]
    mesh = load(out).mesh
    assert set(mesh.GetMaterials()) == {"brain", "ventricles"} and mesh.ne == len(made.tets)
    page = out.with_name("report.html").read_text(encoding="utf-8")
    assert "Labels (ml)" not in page and "imported" in page and "ventricles" in page
    assert "lengths are in m: a body of 40 by 40 by 40 mm" in capsys.readouterr().out
    for option in (["--size", "4"], ["--route", "hull"], ["--labels"], ["--cut", "0,0,0"]):
        assert main(["mesh", str(tmp_path / "head.msh"), "--unit", "m", *option, "--overwrite", "-o", str(out)]) == 2
        assert f"{option[0]} is given with a mesh" in capsys.readouterr().err
    capsys.readouterr()
    millimetres = [str(tmp_path / "head.msh"), "--mesh-unit", "mm", "-o"]
    assert main(["mesh", *millimetres, str(tmp_path / "mm" / "head.vtk")]) == 0  # its own unit is what it states: m
    assert np.ptp(meshio.vtk.read(tmp_path / "mm" / "head.vtk").points) == pytest.approx(40, rel=0.02)
    assert main(["mesh", *millimetres, str(tmp_path / "no" / "head.vtkhdf")]) == 2
    assert "--mesh-unit is 'mm'; wanted: m in head.vtkhdf" in capsys.readouterr().err
    unstated = (tmp_path / "head.msh").read_bytes().split(b"$EndComments\n")[1]
    (tmp_path / "other.msh").write_bytes(unstated)
    assert main(["mesh", str(tmp_path / "other.msh"), "-o", str(tmp_path / "no" / "head.vtkhdf")]) == 2
    assert "unit is mm, in which the body is 3.98e-05 m wide" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_surfaces_one_in_the_other_become_a_mesh(tmp_path, capsys):
    for name, radius in (("lh.pial", 30), ("inside", 12)):
        points, triangles = contour(np.linalg.norm(np.indices((45, 45, 45)) - 22, axis=0) < 20)
        points = points - 22
        points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
        meshio.Mesh(points, [("triangle", triangles)]).write(tmp_path / f"{name}.stl")
    out = tmp_path / "out" / "head.msh"
    files = [str(tmp_path / "lh.pial.stl"), f"ventricles={tmp_path / 'inside.stl'}"]
    assert main(["mesh", *files, "--size", "8", "-o", str(out)]) == 0
    result = json.loads(out.with_name("result.json").read_text())
    assert result["regions"]["ventricles"]["volume_ml"] == pytest.approx(4 / 3 * np.pi * 1.2**3, rel=0.02)
    assert result["regions"]["brain"]["volume_ml"] == pytest.approx(4 / 3 * np.pi * (3**3 - 1.2**3), rel=0.01)
    assert result["labels"] == "1 grey, 2 ventricles"
    assert "surfaces enclose 113.0 ml (grey), 7.2 ml (ventricles)" in capsys.readouterr().out
    assert main(["mesh", *files, "--structures", "--overwrite", "-o", str(out)]) == 2
    assert "--structures is given with surfaces" in capsys.readouterr().err
    assert main(["mesh", files[0], str(tmp_path / "t1.nii.gz"), "--overwrite", "-o", str(out)]) == 2
    assert "t1.nii.gz; wanted: a closed surface" in capsys.readouterr().err
    assert main(["mesh", "a.nii.gz", "b.nii.gz", "--overwrite", "-o", str(out)]) == 2
    assert "IMAGE is 2 files; wanted: one" in capsys.readouterr().err
