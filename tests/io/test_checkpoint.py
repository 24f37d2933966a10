"""Checkpoints: geometry and fields, exact to the last bit, and never incomplete."""

import os

import h5py
import netgen.occ as occ
import ngsolve as ng
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.io import Frame, QuadraticGrid, checkpoint, load, save


@pytest.fixture(scope="module")
def ball() -> QuadraticGrid:
    """A curved ball of "brain" in a box of "csf"; the names are as awkward as users make them."""
    ball = occ.Sphere((0, 0, 0), 0.05)
    ball.faces.name = "pia"
    box = occ.Box((-0.08, -0.08, -0.08), (0.08, 0.08, 0.08)) - ball
    ball.mat("brain"), box.mat("liquor ä")
    mesh = ng.Mesh(occ.OCCGeometry(occ.Glue([ball, box])).GenerateMesh(maxh=0.04))
    return QuadraticGrid(mesh.Curve(2))


@pytest.fixture
def saved(tmp_path, ball):
    """A small valid checkpoint: its path and bytes."""
    path = tmp_path / "run.vtkhdf"
    save(path, ball, [Frame(0.0, {"p": ball.points[:, 0]})], {"history": np.arange(500.0)})
    return path, path.read_bytes()


# --- there and back ---------------------------------------------------------------------------------------------------

RNG = np.random.default_rng(1)
STATE = {
    "u": RNG.standard_normal(1000),
    "single": np.float32([1 / 3, np.inf, -0.0]),
    "nan with payload": np.array([0x7FF8_0000_DEAD_BEEF], np.uint64).view(np.float64),
    "complex": RNG.standard_normal(4) + 1j * RNG.standard_normal(4),
    "active/set": np.array([[True, False], [False, True]]),
    "big endian": np.arange(4, dtype=">i2"),
    "half": np.float16([0.1]),
    "long": np.array([1, 3], np.longdouble) / 7,
    "names": np.array(["brain", "ä"]),
    "dates": np.array(["2026-01-02"], "M8[D]"),
    "records": np.array([(1, 0.1)], [("i", "i4"), ("x", "f8")]),
    "empty": np.zeros((0, 3)),
    "scalar": np.array(0.1),
    "column": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "nested": {"tau": 0.1 + 0.2, "deeper": {"none": None, "flag": True, "array": np.arange(3)}, "": {}},
    "numbers": [1, 2.5, -0.0, float("inf"), 2**80, 5e-324],
    "branches": [np.arange(2.0), np.arange(3.0)],
    "marks": ["array", 0],
    "pair": (1, [2, ()]),
    "step": 12,
    "protocol": "Zug\n\x00 'ä'",
    "numpy's": [np.int64(7), np.float32(0.1), np.float64(0.1), np.bool_(True), np.complex64(1j), np.longdouble(1) / 3],
}


def same(a, b) -> bool:
    if isinstance(a, np.ndarray):
        return type(b) is np.ndarray and (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    if isinstance(a, dict):
        return type(b) is dict and list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and repr(a) == repr(b)


def test_state_comes_back_to_the_last_bit(tmp_path, ball):
    save(tmp_path / "run.vtkhdf", ball, state=STATE)
    back = load(tmp_path / "run.vtkhdf").state
    assert list(back) == list(STATE)
    assert [name for name in STATE if not same(STATE[name], back[name])] == []


def test_the_mesh_comes_back_exact_and_carries_the_unknowns(tmp_path, ball):
    fes = ng.VectorH1(ball.mesh, order=4, dirichlet="pia")
    u = ng.GridFunction(fes)
    u.vec.FV().NumPy()[:] = RNG.standard_normal(fes.ndof)
    save(tmp_path / "run.vtkhdf", ball, [Frame(0.0, {"u": ball.values(u)})], {"u": u.vec.FV().NumPy()})
    back = load(tmp_path / "run.vtkhdf")

    assert back.mesh.GetMaterials() == ball.mesh.GetMaterials()
    assert back.mesh.GetBoundaries() == ball.mesh.GetBoundaries() and "pia" in back.mesh.GetBoundaries()
    assert np.array_equal(back.grid.points, ball.points)
    assert np.array_equal(back.grid.connectivity, ball.connectivity)
    fes_back = ng.VectorH1(back.mesh, order=4, dirichlet="pia")
    assert list(fes_back.FreeDofs()) == list(fes.FreeDofs())
    u_back = ng.GridFunction(fes_back)
    u_back.vec.FV().NumPy()[:] = back.state["u"]
    # An interior rule, so that edge and face numbers count too.
    rule = ng.IntegrationRule(ng.TET, 3)
    there, here = (g(g.space.mesh.MapToAllElements({ng.TET: rule}, ng.VOL)) for g in (u, u_back))
    assert np.array_equal(there, here)
    places = ng.CF((ng.x, ng.y, ng.z))
    at, back_at = (np.asarray(places(m.MapToAllElements({ng.ET.TET: rule}, ng.VOL))) for m in (ball.mesh, back.mesh))
    assert abs(at - back_at).max() < 1e-15  # curved as before
    assert np.array_equal(back.frames[0].point_data["u"], ball.values(u))


def test_frames_and_cell_data_come_back_to_the_last_bit(tmp_path, ball):
    u, p, E = ball.points, np.float32(ball.points[:, 0]), RNG.random((len(ball.points), 9))
    frames = [Frame(t, {"u": t * u, "p": p + np.float32(t), "E": E}) for t in (0.0, 0.1, 1 / 3)]
    quality = RNG.random(ball.mesh.ne)
    save(tmp_path / "run.vtkhdf", ball, frames, cell_data={"quality": quality})
    back = load(tmp_path / "run.vtkhdf")
    assert [frame.time for frame in back.frames] == [0.0, 0.1, 1 / 3]
    for there, here in zip(frames, back.frames, strict=True):
        assert all(same(there.point_data[name], here.point_data[name]) for name in ("u", "p", "E"))
    assert list(back.cell_data) == ["quality"] and same(back.cell_data["quality"], quality)

    # What was loaded can be saved and goes on.
    save(tmp_path / "run.vtkhdf", back.grid, [*back.frames, Frame(2, frames[0].point_data)], back.state, back.cell_data)
    assert [frame.time for frame in load(tmp_path / "run.vtkhdf").frames] == [0.0, 0.1, 1 / 3, 2.0]


def test_no_frames_no_state(tmp_path, ball):
    save(tmp_path / "mesh.vtkhdf", ball)
    back = load(tmp_path / "mesh.vtkhdf")
    assert (back.frames, back.state, back.cell_data) == ((), {}, {}) and back.mesh.ne == ball.mesh.ne


def test_layout_follows_the_vtkhdf_specification(tmp_path, ball):
    """VTKHDF 2.2, UnstructuredGrid with Steps, as ParaView reads it; VTK's reader (9.7.2) was tried by hand."""
    n, ntets, steps = len(ball.points), len(ball.connectivity), 3
    frames = [Frame(k / 2, {"p": np.full(n, k, float), "u": np.full((n, 3), k, float)}) for k in range(steps)]
    save(tmp_path / "run.vtkhdf", ball, frames)
    with h5py.File(tmp_path / "run.vtkhdf", "r") as file:
        vtk = file["VTKHDF"]
        assert list(vtk.attrs["Version"]) == [2, 2] and vtk.attrs["Type"] == b"UnstructuredGrid"
        kind = vtk.attrs.get_id("Type").get_type()
        assert not kind.is_variable_str() and kind.get_cset() == h5py.h5t.CSET_ASCII
        counts = {"NumberOfPoints": [n], "NumberOfCells": [ntets], "NumberOfConnectivityIds": [10 * ntets]}
        assert {name: list(vtk[name]) for name in counts} == counts
        assert np.array_equal(vtk["Points"], ball.points)
        assert np.array_equal(vtk["Offsets"], 10 * np.arange(ntets + 1))
        assert np.array_equal(np.reshape(vtk["Connectivity"], (-1, 10)), ball.connectivity)
        assert set(vtk["Types"][()]) == {24} and vtk["Types"].shape == (ntets,) and vtk["Types"].dtype == np.uint8
        assert np.array_equal(vtk["CellData/region"], ball.region)
        assert [name.decode() for name in vtk["FieldData/region_names"]] == list(ball.region_names)
        text = vtk["FieldData/region_names"].id.get_type()  # VTK 9.7 crashes on any other kind of text
        assert text.is_variable_str() and text.get_cset() == h5py.h5t.CSET_ASCII

        series = vtk["Steps"]
        assert series.attrs["NSteps"] == steps and list(series["Values"]) == [0, 0.5, 1]
        assert list(series["NumberOfParts"]) == [1] * steps
        for name in ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets", "CellDataOffsets/region"):
            assert list(series[name]) == [0] * steps, name  # the geometry is there once
        for name, shape in {"p": (), "u": (3,)}.items():
            data, offsets = vtk["PointData"][name], series["PointDataOffsets"][name]
            assert data.shape == (steps * n, *shape) and list(offsets) == [0, n, 2 * n]
            assert [np.unique(data[start : start + n]).tolist() for start in offsets] == [[0], [1], [2]]


# --- never half a file ------------------------------------------------------------------------------------------------


def refused(path) -> str:
    with pytest.raises(InputError) as caught:
        load(path)
    assert caught.value.field == "checkpoint" and str(path) in str(caught.value) and "\n" not in str(caught.value)
    return str(caught.value)


def test_a_truncated_file_is_refused(saved):
    path, whole = saved
    for size in (0, 1, 47, 48, 100, 4096, len(whole) // 2, len(whole) - 48, len(whole) - 32, len(whole) - 1):
        path.write_bytes(whole[:size])
        assert "cut short" in refused(path), size


def test_a_flipped_byte_anywhere_is_refused(saved, ball):
    path, whole = saved
    history = whole.index(np.arange(500.0).tobytes()) + 8 * 250
    mesh, last = whole.index(ball.arrays["tetrahedra"].tobytes()[:400]), len(whole) - 1
    for at in (0, 9, 200, history, mesh, *range(300, last, last // 20), last - 60, last - 48, last - 40, last):
        damaged = bytearray(whole)
        damaged[at] ^= 0x10
        path.write_bytes(damaged)
        refused(path)
    path.write_bytes(whole)
    assert load(path).state["history"][250] == 250


def test_foreign_and_missing_files_are_refused(tmp_path):
    assert "missing" in refused(tmp_path / "absent.vtkhdf")
    assert "a folder" in refused(tmp_path)
    (tmp_path / "text.vtkhdf").write_text("not a checkpoint " * 100)
    with h5py.File(tmp_path / "foreign.vtkhdf", "w") as file:
        file["VTKHDF/Points"] = np.zeros((1000, 3))
    for name in ("text.vtkhdf", "foreign.vtkhdf"):
        assert "ngbrain did not write it" in refused(tmp_path / name)


@pytest.mark.parametrize("function", ["os.replace", "os.fsync", "checkpoint._digest", "checkpoint._write_vtk"])
def test_death_while_saving_leaves_the_old_file(saved, ball, monkeypatch, function):
    path, whole = saved
    module, name = function.split(".")

    def die(*_args):
        raise KeyboardInterrupt

    monkeypatch.setattr({"os": os, "checkpoint": checkpoint}[module], name, die)
    with pytest.raises(KeyboardInterrupt):
        save(path, ball, state={"history": np.zeros(500)})
    monkeypatch.undo()
    assert path.read_bytes() == whole and load(path).state["history"][250] == 250
    assert os.listdir(path.parent) == [path.name]


def test_the_new_file_is_on_disk_before_it_takes_the_name(saved, ball, monkeypatch):
    path, _ = saved
    path.with_name(f".run.{2**22 + 1}.00ff.tmp.vtkhdf").write_text("left by a process that was killed")
    other = path.with_name(f".run.{os.getppid()}.00ff.tmp.vtkhdf")
    other.write_text("of one that is at it")
    calls = []
    real_fsync, real_replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda fd: (calls.append(("fsync", os.fstat(fd).st_size)), real_fsync(fd)))

    def replace(part, target):
        load(part)  # already whole
        assert part.parent == target.parent  # a rename is atomic only within a folder
        calls.append(("replace", part.stat().st_size))
        real_replace(part, target)

    monkeypatch.setattr(os, "replace", replace)
    save(path, ball)
    assert sorted(os.listdir(path.parent)) == sorted([path.name, other.name])
    assert [name for name, _ in calls] == ["fsync", "replace"] and calls[0][1] == calls[1][1] == path.stat().st_size


def test_another_format_or_ngsolve_is_named(saved, ball, monkeypatch):
    path, _ = saved
    monkeypatch.setattr(checkpoint, "_FORMAT", 3)
    save(path, ball)
    monkeypatch.undo()
    assert "format 2, not 3" in refused(path)

    monkeypatch.setattr(ng, "__version__", "5.0.1")
    save(path, ball)
    monkeypatch.undo()
    assert load(path).mesh.ne == ball.mesh.ne  # another version is no reason in itself

    def renumbered(mesh):
        grid = object.__new__(QuadraticGrid)
        grid.__dict__.update(ball.__dict__, connectivity=ball.connectivity[:, ::-1])
        return grid

    monkeypatch.setattr(checkpoint, "QuadraticGrid", renumbered)
    assert "ngsolve 5.0.1" in refused(path)
    monkeypatch.undo()


def test_no_pickle_is_loaded_from_a_file(saved, ball, monkeypatch):
    """A checkpoint of an earlier version has one; it, and one that is sealed anew around other contents, is refused unread."""
    path, _ = saved
    monkeypatch.setattr(checkpoint, "_FORMAT", 1)
    save(path, ball)
    monkeypatch.undo()
    assert "can run any code" in refused(path)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("tetrahedra", np.full((5, 4), 10**6, np.int32)),  # Netgen would read beyond its memory
        ("tetrahedra", np.full((5, 4), -1, np.int32)),
        ("triangles", np.full((5, 3), 10**6, np.int32)),
        ("region", np.array([7], np.int32)),
        ("points", np.full((9, 3), np.nan)),
        ("points", np.zeros((9, 2))),
        ("points", np.zeros((0, 3))),
        ("faces", np.full((7, 4), 10**6, np.int32)),
        ("face_names", np.frombuffer(b"a\n", np.uint8)),
        ("face_names", np.frombuffer(b"\xff\n", np.uint8)),
        ("faces", None),
    ],
)
def test_a_sealed_file_with_another_mesh_is_refused(saved, ball, monkeypatch, name, values):
    path, _ = saved
    changed = {key: array for key, array in ball.arrays.items() if key != name}
    monkeypatch.setattr(ball, "arrays", changed if values is None else changed | {name: values})
    save(path, ball)
    assert name.removesuffix("_names") in refused(path)


def test_a_sealed_file_that_refers_to_another_is_refused(saved, tmp_path):
    path, _ = saved
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["secret"] = np.arange(3.0)
    for link in ("ngbrain/arrays/0", "VTKHDF/PointData/p"):
        with h5py.File(path, "w") as file:
            file[link] = h5py.ExternalLink(str(tmp_path / "other.h5"), "secret")
        with open(path, "r+b") as stream:
            stream.write(checkpoint._MARK + checkpoint._digest(stream, path.stat().st_size))
        assert "in another file" in refused(path)


@pytest.mark.parametrize(
    ("state", "field"),
    [
        ({"a": {"b": [1, {2, 3}]}}, "state.a.b[1]"),
        ({"a": np.array([None])}, "state.a"),
        ({"a": {1: 2}}, "state.a"),
        ({"u": ng.BaseVector(3)}, "state.u"),
        ({"z": 1j}, "state.z"),
    ],
)
def test_state_that_cannot_be_kept_is_named(tmp_path, ball, state, field):
    with pytest.raises(InputError) as caught:
        save(tmp_path / "run.vtkhdf", ball, state=state)
    assert caught.value.field == field and os.listdir(tmp_path) == []


def test_fields_that_do_not_fit_are_named(tmp_path, ball):
    n, path = len(ball.points), tmp_path / "run.vtkhdf"
    good = Frame(0.0, {"u": np.zeros((n, 3))})
    for frames in (
        [Frame(0.0, {"u": np.zeros(n - 1)})],
        [Frame(0.0, {"u": np.zeros((n, 3), complex)})],
        [Frame(0.0, {"u": np.zeros((n, 3, 3))})],
        [Frame(0.0, {"a/b": np.zeros(n)})],
        [Frame(0.0, {"": np.zeros(n)})],
        [good, Frame(1.0, {})],
        [good, Frame(1.0, {"u": np.zeros(n)})],
        [good, Frame(1.0, {"u": np.zeros((n, 3), "f4")})],
        [good, Frame(0.0, good.point_data)],
        [Frame(float("nan"), {})],
    ):
        with pytest.raises(InputError, match="frames"):
            save(path, ball, frames)
    for cell_data in ({"q": np.zeros(n)}, {"region": np.zeros(ball.mesh.ne)}):
        with pytest.raises(InputError, match="cell_data"):
            save(path, ball, cell_data=cell_data)
    with pytest.raises(InputError, match="folder that exists"):
        save(tmp_path / "nowhere" / "run.vtkhdf", ball)
    assert os.listdir(tmp_path) == []
