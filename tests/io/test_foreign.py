"""Meshes as other programs write them: names by number and dimension, each cell once, parts, sets, units."""

import itertools
import struct

import meshio
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.io.exchange import write_mesh
from ngbrain.io.foreign import read_mesh
from ngbrain.mesh.quality import volumes_ml

# A box of 100 by 100 by 100 mm in two halves, each of six tetrahedra around a diagonal.
POINTS = np.array(list(itertools.product((0, 50, 100), (0, 100), (0, 100))), float)


def half(first):
    corners = {key: first * 4 + 4 * key[0] + 2 * key[1] + key[2] for key in itertools.product((0, 1), repeat=3)}
    found = []
    for order in itertools.permutations(range(3)):
        path = [(0, 0, 0)]
        for axis in order:
            path.append(tuple(1 if k == axis else c for k, c in enumerate(path[-1])))
        found.append([corners[key] for key in path])
    return np.array(found)


LEFT, RIGHT = half(0), half(1)


def side(tets, axis, value):
    faces = tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3)
    return faces[(POINTS[faces][:, :, axis] == value).all(axis=1)]


INLET, WALL = side(LEFT, 0, 0), side(LEFT, 0, 50)


def msh41(path, groups):
    """As Gmsh writes it: entities with their bounding ones, of which each may be in several physical groups."""
    names = "\n".join(f'{dimension} {tag} "{name}"' for dimension, tag, name in groups["names"])
    nodes = (
        "\n".join(map(str, range(1, len(POINTS) + 1)))
        + "\n"
        + "\n".join(" ".join(map(str, p)) for p in POINTS.tolist())
    )
    blocks, number = [], itertools.count(1)
    for dimension, tag, cells in ((2, 1, INLET), (2, 2, WALL), (3, 1, LEFT), (3, 2, RIGHT)):
        rows = [f"{next(number)} {' '.join(map(str, row))}" for row in (cells + 1).tolist()]
        blocks.append(f"{dimension} {tag} {2 if dimension == 2 else 4} {len(rows)}\n" + "\n".join(rows))
    entities = [
        f"{tag} 0 0 0 100 100 100 {len(of)} {' '.join(map(str, of))} {len(bounds)} {' '.join(map(str, bounds))}".strip()
        for tag, of, bounds in groups["entities"]
    ]
    total = sum(map(len, (INLET, WALL, LEFT, RIGHT)))
    path.write_text(
        f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n{len(groups['names'])}\n{names}\n$EndPhysicalNames\n"
        "$Entities\n0 0 2 2\n" + "\n".join(entities) + "\n$EndEntities\n"
        f"$Nodes\n1 {len(POINTS)} 1 {len(POINTS)}\n3 1 0 {len(POINTS)}\n{nodes}\n$EndNodes\n"
        f"$Elements\n4 {total} 1 {total}\n" + "\n".join(blocks) + "\n$EndElements\n"
    )
    return path


def msh22(path, names, cells):
    """cells: dimension, physical tag, (n, k)."""
    rows = [
        f"{2 if dimension == 2 else 4} 2 {tag} {tag} {' '.join(map(str, row))}"
        for dimension, tag, block in cells
        for row in (block + 1).tolist()
    ]
    path.write_text(
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n{len(names)}\n"
        + "\n".join(f'{dimension} {tag} "{name}"' for dimension, tag, name in names)
        + f"\n$EndPhysicalNames\n$Nodes\n{len(POINTS)}\n"
        + "\n".join(f"{i} {' '.join(map(str, p))}" for i, p in enumerate(POINTS.tolist(), 1))
        + f"\n$EndNodes\n$Elements\n{len(rows)}\n"
        + "\n".join(f"{i} {row}" for i, row in enumerate(rows, 1))
        + "\n$EndElements\n"
    )
    return path


NAMES = [(3, 1, "grey"), (3, 2, "white"), (2, 1, "inlet"), (2, 2, "wall")]


def areas(mesh):
    x = mesh.points[mesh.triangles]
    area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 2
    return {name: 1e6 * area[mesh.boundary == i].sum() for i, name in enumerate(mesh.boundaries)}


def checked(mesh):
    assert volumes_ml(mesh) == pytest.approx({"grey": 500.0, "white": 500.0}) and (mesh.volumes() > 0).all()
    found = areas(mesh)
    assert found["inlet"] == pytest.approx(1e4) and found["wall"] == pytest.approx(1e4)
    assert sum(found.values()) == pytest.approx(7e4)  # the rest of the surface too
    x = mesh.points[mesh.triangles[mesh.boundary == mesh.boundaries.index("inlet")]]
    assert (np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])[:, 0] < 0).all()  # outwards
    assert set(mesh.mesh().GetMaterials()) == {"grey", "white"}


def test_gmsh_41_has_names_by_dimension_and_no_bounding_entities(tmp_path):
    entities = [(1, [1], []), (2, [2], []), (1, [1], [1, 2]), (2, [2], [2])]
    mesh = read_mesh(msh41(tmp_path / "box.msh", {"names": NAMES, "entities": entities}), "mm")
    checked(mesh)
    assert set(mesh.boundaries) == {"inlet", "wall", "outer_grey", "outer_white"}


def test_a_cell_of_two_groups_is_of_the_smaller_and_there_once(tmp_path):
    names = [(3, 1, "grey"), (3, 2, "white"), (3, 3, "tissue"), (2, 1, "inlet"), (2, 2, "wall")]
    entities = [(1, [1], []), (2, [2], []), (1, [3, 1], [1, 2]), (2, [2, 3], [2])]
    checked(read_mesh(msh41(tmp_path / "box41.msh", {"names": names, "entities": entities}), "mm"))
    cells = [(3, 3, LEFT), (3, 1, LEFT), (3, 2, RIGHT), (3, 3, RIGHT), (2, 1, INLET), (2, 2, WALL), (2, 2, WALL)]
    mesh = read_mesh(msh22(tmp_path / "box22.msh", names, cells), "mm")
    checked(mesh)
    assert len(mesh.tets) == 12


def test_gmsh_22_with_equal_numbers_in_two_dimensions(tmp_path):
    cells = [(2, 1, INLET), (2, 2, WALL), (3, 1, LEFT), (3, 2, RIGHT)]
    checked(read_mesh(msh22(tmp_path / "box.msh", NAMES, cells), "mm"))
    bare = read_mesh(msh22(tmp_path / "bare.msh", [], cells), "mm")
    assert bare.regions == ("region_1", "region_2") and {"boundary_1", "boundary_2"} <= set(bare.boundaries)


def test_abaqus_with_quadratic_elements_and_sets(tmp_path):
    edges = np.unique(
        np.sort(np.concatenate([LEFT, RIGHT])[:, list(itertools.combinations(range(4), 2))].reshape(-1, 2)), axis=0
    )
    points = np.concatenate([POINTS, POINTS[edges].mean(axis=1)])
    place = {tuple(edge): len(POINTS) + i for i, edge in enumerate(edges.tolist())}
    order = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
    text = ["*NODE", *(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(points.tolist(), 1))]
    number = itertools.count(1)
    for name, tets in (("grey", LEFT), ("white", RIGHT)):
        text.append(f"*ELEMENT, TYPE=C3D10, ELSET={name}")
        for tet in tets.tolist():
            middle = [place[tuple(sorted((tet[i], tet[j])))] for i, j in order]
            text.append(", ".join(str(n) for n in [next(number), *(1 + np.array(tet + middle)).tolist()]))
    for name, triangles in (("inlet", INLET), ("wall", WALL)):
        text.append(f"*ELEMENT, TYPE=S3, ELSET={name}")
        text += [", ".join(map(str, [next(number), *row])) for row in (triangles + 1).tolist()]
    (tmp_path / "box.inp").write_text("\n".join(text) + "\n")
    mesh = read_mesh(tmp_path / "box.inp", "mm")
    checked(mesh)
    assert len(mesh.points) == len(POINTS)


def elements(kind, name, cells, first):
    rows = [", ".join(map(str, [first + i, *row])) for i, row in enumerate((cells + 1).tolist())]
    return [f"*Element, type={kind}" + (f", elset={name}" if name else ""), *rows]


def test_abaqus_as_preprocessors_write_it(tmp_path):
    """Hybrid elements, two blocks of nodes, one set of several blocks, sets by ranges and of sets, triangles of any family."""
    nodes = [f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(POINTS.tolist(), 1)]
    text = ["*Heading", "** made by hand", "*Part, name=brain", "*Node, nset=first", *nodes[:7], "*Node", *nodes[7:]]
    text += elements("C3D4H", "grey", LEFT[:2], 1) + elements("DC3D4", "grey", LEFT[2:], 3)
    text += elements("C3D4", "", RIGHT, 7) + elements("SPRINGA", "held", np.array([[0, 1]]), 90)
    text += elements("CPS3", "", INLET, 101) + elements("R3D3", "wall", WALL, 111)
    text += ["*Elset, elset=deep, generate", "7, 10, 1", "*Elset, elset=white", "deep, 11,", "12"]
    text += ["*Elset, elset=inlet,", "instance=brain", "101, 102", "*Elset, elset=all", "grey, white", "*End part"]
    (tmp_path / "box.inp").write_text("\n".join(text))
    mesh = read_mesh(tmp_path / "box.inp", "mm")
    volumes = volumes_ml(mesh)
    assert volumes["grey"] == pytest.approx(500) and volumes["deep"] + volumes["white"] == pytest.approx(500)
    assert volumes["white"] == pytest.approx(500 / 3)  # the smallest set of a cell has it
    assert {"inlet", "wall"} <= set(mesh.boundaries)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("*Node", "*Include, input=more.inp\n*Node"), "one that includes others"),
        (("*Node", "*Part, name=a\n*Part, name=b\n*Node"), "with 2 parts"),
        (("1, 0.0", "1, zero"), "unreadable"),
        (("C3D4", "C3D10"), "unreadable"),
        (("C3D4", "C3D8"), "with other elements"),
        (("\n12,", "\n13,"), "unreadable"),
    ],
)
def test_abaqus_that_is_refused(tmp_path, change, message):
    nodes = [f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(POINTS.tolist(), 1)]
    text = "\n".join(["*Node", *nodes, *elements("C3D4", "grey", np.concatenate([LEFT, RIGHT]), 1)])
    (tmp_path / "box.inp").write_text(text)
    assert read_mesh(tmp_path / "box.inp", "mm").regions == ("grey",)
    (tmp_path / "box.inp").write_text(text.replace(*change))
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "box.inp", "mm")


@pytest.mark.parametrize("geometry", ["Mesh", "Geometry"])
def test_febio_with_nodes_by_id_and_other_parts(geometry, tmp_path):
    def rows(tag, cells):
        return "".join(
            f'<{tag} id="{i}">{",".join(str(10 + n) for n in row)}</{tag}>' for i, row in enumerate(cells.tolist(), 1)
        )

    nodes = "".join(f'<node id="{10 + i}">{x},{y},{z}</node>' for i, (x, y, z) in enumerate(POINTS.tolist()))
    parts = f'<Elements type="tet4" name="grey">{rows("elem", LEFT)}</Elements>'
    parts += f'<Elements type="tet4" name="white">{rows("elem", RIGHT)}</Elements>'
    parts += f'<Surface name="inlet">{rows("tri3", INLET)}</Surface><Surface name="wall">{rows("tri3", WALL)}</Surface>'
    whole = f'<febio_spec version="4.0"><{geometry}><Nodes>{nodes}</Nodes>{parts}</{geometry}></febio_spec>'
    (tmp_path / "box.feb").write_text(whole)
    checked(read_mesh(tmp_path / "box.feb", "mm"))
    mixed = whole.replace(
        "<Surface", '<Elements type="hex8" name="b"><elem id="99">1,2,3,4,5,6,7,8</elem></Elements><Surface', 1
    )
    (tmp_path / "mixed.feb").write_text(mixed)
    with pytest.raises(InputError, match=r"with other elements \(1 of type hex8\); wanted: tetrahedra alone"):
        read_mesh(tmp_path / "mixed.feb", "mm")
    (tmp_path / "half.feb").write_text(whole[:-40])
    with pytest.raises(InputError, match=r"half.feb: mesh file is unreadable"):
        read_mesh(tmp_path / "half.feb", "mm")


def test_vtk_without_an_end_of_line_has_regions_by_the_only_whole_numbers(tmp_path):
    cells = np.concatenate([LEFT, RIGHT])
    head = f"# vtk DataFile Version 2.0\nbox, Created by Gmsh\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS {len(POINTS)} double\n"
    raw = head.encode() + POINTS.astype(">f8").tobytes() + f"\nCELLS {len(cells)} {5 * len(cells)}\n".encode()
    raw += (
        np.column_stack([np.full(len(cells), 4), cells]).astype(">i4").tobytes()
        + f"\nCELL_TYPES {len(cells)}\n".encode()
    )
    raw += struct.pack(f">{len(cells)}i", *[10] * len(cells)) + f"\nCELL_DATA {len(cells)}\n".encode()
    raw += b"SCALARS CellEntityIds int 1\nLOOKUP_TABLE default\n" + struct.pack(">12i", *[4] * 6, *[9] * 6)
    (tmp_path / "box.vtk").write_bytes(raw)
    mesh = read_mesh(tmp_path / "box.vtk", "mm")
    assert volumes_ml(mesh) == pytest.approx({"region_4": 500.0, "region_9": 500.0})
    assert mesh.boundaries == ("outer_region_4", "outer_region_9", "region_4_region_9")
    plain = meshio.Mesh(
        POINTS, [("tetra", cells)], cell_data={"part": [np.array([1.0] * 6 + [2.0] * 6)], "e": [np.arange(12) / 7]}
    )
    meshio.write(tmp_path / "plain.vtu", plain)
    assert read_mesh(tmp_path / "plain.vtu", "mm").regions == ("region_1", "region_2")


def test_netgen_reads_back_with_its_names(tmp_path):
    cells = [(2, 1, INLET), (2, 2, WALL), (3, 1, LEFT), (3, 2, RIGHT)]
    mesh = read_mesh(msh22(tmp_path / "box.msh", NAMES, cells), "mm")
    write_mesh(tmp_path / "box.vol.gz", mesh)
    checked(read_mesh(tmp_path / "box.vol.gz"))


def test_a_face_inside_a_region_stays_and_what_is_no_face_goes(tmp_path):
    inner = np.array([LEFT[0][[0, 1, 3]], [0, 3, 9]])
    cells = [(2, 1, INLET), (2, 2, WALL), (3, 1, LEFT), (3, 2, RIGHT), (2, 3, inner)]
    mesh = read_mesh(msh22(tmp_path / "box.msh", [*NAMES, (2, 3, "falx")], cells), "mm")
    checked_names = dict(zip(mesh.boundaries, np.bincount(mesh.boundary).tolist(), strict=True))
    assert checked_names["falx"] == 1


def test_units_in_which_no_body_is_are_refused(tmp_path):
    cells = [(3, 1, LEFT), (3, 2, RIGHT)]
    path = msh22(tmp_path / "box.msh", NAMES, cells)
    assert sum(volumes_ml(read_mesh(path, "cm")).values()) == pytest.approx(1e6)
    with pytest.raises(
        InputError, match=r"unit is m, in which the body is 100 m wide; wanted: 5 mm to 3 m, as it is in cm or mm"
    ):
        read_mesh(path)
    with pytest.raises(InputError, match=r"unit is um, in which the body is 0.0001 m wide"):
        read_mesh(path, "um")


def test_what_is_no_mesh_of_tetrahedra(tmp_path):
    path = tmp_path / "flat.msh"
    flat = LEFT.copy()
    flat[0] = [0, 1, 2, 3]
    with pytest.raises(InputError, match=r"with 1 flat tetrahedra"):
        read_mesh(msh22(path, NAMES, [(3, 1, flat)]), "mm")
    with pytest.raises(InputError, match=r"without tetrahedra"):
        read_mesh(msh22(path, NAMES, [(2, 1, INLET)]), "mm")
    meshio.write(
        tmp_path / "hex.vtu",
        meshio.Mesh(POINTS, [("tetra", LEFT), ("hexahedron", np.array([[0, 4, 6, 2, 1, 5, 7, 3]]))]),
    )
    with pytest.raises(InputError, match=r"with other elements \(1 of type hexahedron\)"):
        read_mesh(tmp_path / "hex.vtu", "mm")
    with pytest.raises(
        InputError, match=r"head.xyz: mesh file is called head.xyz; wanted: a name that ends in .msh, .vtu"
    ):
        (tmp_path / "head.xyz").write_text("1")
        read_mesh(tmp_path / "head.xyz")
