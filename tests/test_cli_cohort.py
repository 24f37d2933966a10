"""The verb `cohort` on the command line: its template, what it refuses and says, and how it ends."""

import pytest

from ngbrain.cli import main
from ngbrain.cli.options.cohort import SAMPLE, VERBS, columns_of, several_inputs
from ngbrain.cli.options.common import parsers
from ngbrain.datasets import SHIPPED


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "waves.npz").write_bytes((SHIPPED / "waves_plane.npz").read_bytes())
    (tmp_path / "list.csv").write_text("name,verb,input,centre\na,predict,waves.npz,Ulm\n")
    return tmp_path


def test_the_template_is_printed(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["cohort", "--template"])
    assert ended.value.code == 0 and capsys.readouterr().out == SAMPLE.read_text()


def test_each_fault_is_a_line_and_nothing_is_written(study, capsys):
    (study / "list.csv").write_text("name,verb,input\na,predict,x.npz\nb,predict,waves.npz\nb,predict,waves.npz\n")
    assert main(["cohort", "list.csv"]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("ngbrain: list.csv: line 2 (a), input") and "line 4, name" in second
    assert main(["cohort", "none.csv"]) == 2 and "none.csv: list is missing" in capsys.readouterr().err
    assert main(["cohort", "list.csv", "--executor", "abacus"]) == 2 and "'abacus'" in capsys.readouterr().err
    assert sorted(path.name for path in study.iterdir()) == ["list.csv", "waves.npz"]


def test_what_is_said_in_the_end(study, capsys):
    assert main(["cohort", "list.csv", "--group", "centre"]) == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == [
        "1 row: 1 ok",
        "columns that are no option, kept as they are: centre",
        f"table: {study / 'cohort' / 'cohort.csv'}",
        f"report: {study / 'cohort' / 'report.html'}",
    ]
    assert main(["cohort", "list.csv", "-q"]) == 0 and capsys.readouterr() == ("", "")
    (study / "list.csv").write_text("name,verb,input\nb,predict,waves.npz\n")
    assert main(["cohort", "list.csv", "-q"]) == 0
    assert capsys.readouterr().err == f"ngbrain: no longer in the list, but still in {study / 'cohort'}: a\n"


def test_columns_are_options_of_the_verbs():
    found = {verb: set(columns_of(parsers()[verb])) for verb in VERBS}
    assert {"labels", "names", "size", "atlas", "atlas-t1", "no-fill"} <= found["mesh"]
    assert {"noise", "by-label", "drop-outliers", "device"} <= found["invert"] and "template" not in found["invert"]
    for verb in VERBS:
        assert not found[verb] & {"output", "quiet", "force", "threads", "executor", "resume", "help"}, verb
    assert [verb for verb in VERBS if several_inputs(parsers()[verb])] == ["mesh"]
