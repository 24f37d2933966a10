"""Measurements of a retraction from tables: values in SI units, NaN where missing, bad input is named."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.surgery.observations import Observations

HEAD = "t_s,x_mm,y_mm,z_mm,ux_mm,uy_mm,uz_mm\n"


def written(path, text):
    path.write_text(text)
    return path


def test_landmarks_and_forces_at_times_of_their_own(tmp_path):
    moved = written(tmp_path / "l.csv", HEAD + "5,10,20,30,1,0,-0.5\n2, 1, 2, 3, .1, , .3\n5,1,2,3,0.2,0.1,nan\n\n")
    pushed = written(tmp_path / "f.csv", "force_N, t_s\n0.3,5\n0.2,8\n")
    seen = Observations.read(moved, pushed, 0.2, 0.01)
    assert seen.times.tolist() == [2, 5, 8] and seen.sigma == (2e-4, 0.01)
    assert seen.landmarks.tolist() == [[1e-3, 2e-3, 3e-3], [0.01, 0.02, 0.03]]
    expected = np.full((3, 2, 3), np.nan)
    expected[0, 0], expected[1, 0], expected[1, 1] = [1e-4, np.nan, 3e-4], [2e-4, 1e-4, np.nan], [1e-3, 0, -5e-4]
    np.testing.assert_allclose(seen.displacements, expected)
    np.testing.assert_allclose(seen.force, [np.nan, 0.3, 0.2])


def test_one_table_is_enough(tmp_path):
    pushed = written(tmp_path / "f.csv", "\ufefft_s,force_N\n1,0.3\n")
    only = Observations.read(None, pushed, sigma_N=0.02)
    assert only.data.shape == (1, 1) and only.landmarks.shape == (0, 3)
    moved = written(tmp_path / "l.csv", HEAD + "5,10,20,30,1,0,-0.5\n")
    seen = Observations.read(moved, None)
    assert np.isnan(seen.force).all() and seen.data.shape == (1, 4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,x\n1,2\n", "columns is t, x; wanted: .* t_s is missing"),
        ("", "columns is none"),
        (HEAD, "without a row"),
        (HEAD + "1,1,2,3,nan,,\n2,1,2,3\n", "without a number in ux_mm, uy_mm, uz_mm"),
        (HEAD + "1,1,2,3,4,5,6\n1,1,2,3,4,5,7\n", "line 3 is a repetition of line 2"),
        (HEAD + "1,1,2,3,4,five,6\n", "line 2, uy_mm is 'five'"),
        (HEAD + "1,1,,3,4,5,6\n", "line 2, y_mm is ''"),
        (HEAD + "1,1,2,3,4,5,inf\n", "line 2, uz_mm is 'inf'"),
        (HEAD + "1,1,2,3,4\n", "nothing"),
        (HEAD + "1,1,2,3,4,5,6,7\n", "line 2 is 8 cells: '1,1,2,3,4,5,6,7'; wanted: 7, one for each column"),
        (HEAD + "60,0,35,1,5,2,0,1,5,0,3,0,1\n", "line 2 is 13 cells.*decimals with a point"),
        ("t_s,x_mm,y_mm,z_mm,ux_mm,uy_mm,uz_mm,x_mm\n1,1,2,3,4,5,6,7\n", "x_mm is there twice"),
        (HEAD + "1,1,2,3,4,5,3_5\n", "line 2, uz_mm is '3_5'"),
        (HEAD + "-1,1,2,3,4,5,6\n", "line 2, t_s is -1"),
        (HEAD + "nan,1,2,3,4,5,6\n", "line 2, t_s is 'nan'"),
        (HEAD + "5,1,2,3,4,5,6\n2,1,2,3,4,5,6\n", "line 3, t_s is 2.*not before"),
        (HEAD + "1,1,2,3,4,5,1e5\n", "line 2, uz_mm is 100000; wanted: at most 1000"),
        (HEAD + '1,1,2,3,4,5,"6\n', "unreadable"),
        (HEAD + "1,1,2,3,4,5," + "9" * 140000 + "\n", "line 2"),
    ],
)
def test_tables_without_sense_are_refused(tmp_path, text, said):
    path = written(tmp_path / "l.csv", text)
    if said == "nothing":  # a short line: what is not there was not measured
        assert np.isnan(Observations.read(path, None).displacements).tolist() == [[[False, True, True]]]
        return
    with pytest.raises(InputError, match=said) as error:
        Observations.read(path, None)
    assert str(path) in str(error.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_tables_as_spreadsheets_write_them(tmp_path, encoding):
    """Tables in UTF-16 or with a byte-order mark; with semicolons and decimal commas; with tabs."""
    path = tmp_path / "f.csv"
    for text in ("t_s,force_N\r\n60,0.35\r\n", "t_s;force_N\r\n60;0,35\r\n", "t_s\tforce_N\r\n60\t0.35\r\n"):
        path.write_bytes(text.encode(encoding))
        assert Observations.read(None, path).force.tolist() == [0.35]


def test_another_encoding_is_said(tmp_path):
    path = tmp_path / "f.csv"
    path.write_bytes("t_s,force_N,größe\n1,2,3\n".encode("latin-1"))
    with pytest.raises(InputError, match="not UTF-8 in line 1; wanted: text saved as UTF-8"):
        Observations.read(None, path)


@pytest.mark.parametrize(
    ("times", "sigma"),
    [([np.nan], (1, 1)), ([-1.0], (1, 1)), ([2.0, 1.0], (1, 1)), ([1.0], (np.inf, 1)), ([1.0], (1, np.nan))],
)
def test_measurements_in_arrays_are_looked_at_too(times, sigma):
    n = len(times)
    with pytest.raises(InputError, match="Observations"):
        Observations(np.array(times), np.zeros((1, 3)), np.zeros((n, 1, 3)), np.zeros(n), sigma)
