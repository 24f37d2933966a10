"""Meshes in other programs' formats: read back by meshio, Netgen and an XML parser."""

import xml.etree.ElementTree as ElementTree

import meshio
import netgen.meshing as meshing
import ngsolve as ngs
import numpy as np
import pytest
from phantoms import nested

from ngbrain.errors import InputError
from ngbrain.io.exchange import write_mesh
from ngbrain.io.foreign import read_mesh, stated_unit
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.quality import volumes_ml
from ngbrain.mesh.routes.hull import hull

MESHIO = {".msh": meshio.gmsh.read, ".inp": meshio.abaqus.read, ".vtu": meshio.vtu.read, ".vtk": meshio.vtk.read}


@pytest.fixture(scope="module")
def made():
    return hull(nested((20.0, 15.0, 8.0)), RadialSizeField(7e-3, 7e-3)).elements


@pytest.mark.parametrize("suffix", [".msh", ".inp"])
def test_formats_with_names(made, suffix, tmp_path):
    write_mesh(tmp_path / f"head{suffix}", made)
    back = read_mesh(tmp_path / f"head{suffix}")
    assert back.regions == made.regions and back.boundaries == made.boundaries
    assert volumes_ml(back) == pytest.approx(volumes_ml(made), rel=1e-9) and (back.volumes() > 0).all()
    for i in range(len(made.boundaries)):
        mine, theirs = (np.unique(np.sort(m.triangles[m.boundary == i], axis=1), axis=0) for m in (made, back))
        assert np.array_equal(mine, theirs)
    assert set(back.mesh().GetBoundaries()) == set(made.boundaries)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_formats_with_numbers(made, suffix, tmp_path):
    write_mesh(tmp_path / f"head{suffix}", made)
    back = read_mesh(tmp_path / f"head{suffix}")
    assert back.regions == ("region_0", "region_1") and back.boundaries == ("boundary_2", "boundary_3")
    assert list(volumes_ml(back).values()) == pytest.approx(list(volumes_ml(made).values()), rel=1e-9)


@pytest.mark.parametrize("suffix", [".vol", ".vol.gz"])
def test_netgen_reads_its_own(made, suffix, tmp_path):
    write_mesh(tmp_path / f"head{suffix}", made)
    raw = meshing.Mesh()
    raw.Load(str(tmp_path / f"head{suffix}"))
    mesh = ngs.Mesh(raw)
    assert mesh.GetMaterials() == made.regions and set(mesh.GetBoundaries()) == set(made.boundaries)
    ml = [1e6 * ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Materials(name)) for name in made.regions]
    assert ml == pytest.approx(list(volumes_ml(made).values()), rel=1e-6)


def test_febio_has_positive_tetrahedra_by_parts(made, tmp_path):
    write_mesh(tmp_path / "head.feb", made)
    mesh = ElementTree.parse(tmp_path / "head.feb").getroot().find("Mesh")
    points = np.array([[float(c) for c in node.text.split(",")] for node in mesh.find("Nodes")])
    for part, (name, ml) in zip(mesh.findall("Elements"), volumes_ml(made).items(), strict=True):
        tets = np.array([[int(n) for n in elem.text.split(",")] for elem in part]) - 1
        x = points[tets]
        det = np.linalg.det(x[:, 1:] - x[:, :1])
        assert part.get("name") == name and (det > 0).all() and det.sum() / 6e-6 == pytest.approx(ml, rel=1e-6)
    ids = [int(elem.get("id")) for part in mesh.findall("Elements") for elem in part]
    assert ids == list(range(1, len(made.tets) + 1))
    assert [surface.get("name") for surface in mesh.findall("Surface")] == list(made.boundaries)


@pytest.mark.parametrize("suffix", [".msh", ".inp", ".vtu", ".vtk", ".feb"])
@pytest.mark.parametrize("unit", ["m", "mm"])
def test_a_file_states_its_unit_and_is_read_back_so(made, suffix, unit, tmp_path):
    path = tmp_path / f"head{suffix}"
    write_mesh(path, made, unit)
    assert stated_unit(path) == unit
    if suffix != ".feb":  # by another reader: the numbers themselves
        raw = MESHIO[suffix](path).points
        assert np.ptp(raw) == pytest.approx(np.ptp(made.points) / {"m": 1, "mm": 1e-3}[unit])
    back = read_mesh(path)
    assert sorted(volumes_ml(back).values()) == pytest.approx(sorted(volumes_ml(made).values()), rel=1e-6)
    other = "mm" if unit == "m" else "m"
    with pytest.raises(InputError, match=rf"unit is '{other}'; wanted: {unit}, as the file states"):
        read_mesh(path, other)


def test_slicer_finds_the_orientation_in_the_title(made, tmp_path):
    write_mesh(tmp_path / "head.vtk", made, "mm")
    assert (tmp_path / "head.vtk").read_bytes().split(b"\n")[1] == b"unit of length: mm; SPACE=RAS"


@pytest.mark.parametrize("name", ["head.vol", "head.vol.gz"])
def test_meshes_of_netgen_are_in_m(made, name, tmp_path):
    with pytest.raises(InputError, match=f"unit of the mesh is 'mm'; wanted: m in {name}"):
        write_mesh(tmp_path / name, made, "mm")


def test_a_failed_write_leaves_what_was_there(made, tmp_path, monkeypatch):
    path = tmp_path / "head.msh"
    path.write_text("old")

    def fail(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr("meshio.write", fail)
    with pytest.raises(OSError, match="no space"):
        write_mesh(path, made)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_or_read(made, tmp_path):
    with pytest.raises(InputError, match=r"mesh file is 'head.stl'; wanted: .vtu, .vtk, .msh"):
        write_mesh(tmp_path / "head.stl", made)
    with pytest.raises(InputError, match="a file in a folder that exists"):
        write_mesh(tmp_path / "none" / "head.msh", made)
    (tmp_path / "empty.msh").write_text("nothing")
    with pytest.raises(InputError, match=r"empty.msh: mesh file is unreadable \(.*\); wanted: a whole file"):
        read_mesh(tmp_path / "empty.msh")
    with pytest.raises(InputError, match=r"absent.msh: mesh file is missing"):
        read_mesh(tmp_path / "absent.msh")
