"""How far work has come: a bar or a line on a terminal and in a notebook, and a record every half minute."""

import inspect
import logging
import os
import pty
import re
import subprocess
import sys
import threading
import types
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from ngbrain import progress, simulate
from ngbrain.progress import Progress, RunProgress, Step, display, log_progress, notebook, reporting, terminal
from ngbrain.scene import DisplacementBC, Geometry, Quantity, Scene, Tissue


class Clock:
    """Time that passes when somebody waits."""

    def __init__(self, monkeypatch):
        self.now = 1000.0
        monkeypatch.setattr("ngbrain.progress.time.monotonic", lambda: self.now)

    def over_after(self, seconds, on_the_way=lambda now: None):
        """An event that is set then, and what happens while it is waited for."""

        def wait(timeout):
            if self.now + timeout > 1000.0 + seconds:
                return True
            self.now += timeout
            on_the_way(self.now - 1000.0)
            return False

        return types.SimpleNamespace(wait=wait, set=lambda: None, is_set=lambda: False)


@pytest.fixture
def clock(monkeypatch):
    monkeypatch.setattr("ngbrain.progress.threading.Thread.start", lambda _: None)  # tests tick by hand
    return Clock(monkeypatch)


@pytest.fixture
def without(monkeypatch):
    """Packages that are not there; the others are."""

    def lacking(*packages):
        def find(name):
            return None if name in packages else ModuleSpec(name, None)

        monkeypatch.setattr("ngbrain.progress.find_spec", find)

    return lacking


def test_a_record_every_half_minute(clock, caplog):
    caplog.set_level(logging.INFO, "ngbrain")
    line = Progress(text="reading")
    line._over = clock.over_after(100.0, lambda now: line.callback("round 2") if now == 60.0 else None)
    line._tick()
    assert [record.getMessage() for record in caplog.records] == [
        "  30 s  reading",
        "  60 s  round 2",
        "  90 s  round 2",
    ]
    assert {(record.name, record.levelname) for record in caplog.records} == {("ngbrain", "INFO")}


def test_what_reports_nothing_is_on_show_all_the_same(clock, caplog):
    caplog.set_level(logging.INFO, "ngbrain")
    shown = []
    line = Progress(lambda step, seconds: shown.append((str(step), seconds)), text="at work")
    line._over = clock.over_after(61.5)
    line._tick()
    assert shown == [("at work", float(second)) for second in range(3, 62)]
    assert [record.getMessage() for record in caplog.records] == ["  30 s  at work", "  60 s  at work"]


def test_a_line_of_a_terminal(clock, capsys, monkeypatch, without):
    without("tqdm")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with Progress(terminal()) as line:
        line.callback("too soon")
        clock.now += 10.0
        line.callback("round 3")
        clock.now += 0.01
        line.callback("too soon after it")
        line.say("what stays")
        clock.now += 1.0
        line.callback(Step("half", 0.5))
    out, err = capsys.readouterr()
    half = f"  11 s  [{12 * '#'}{12 * '.'}]  50 %  half"
    assert out == "what stays\n" and err == f"\r\x1b[K  10 s  round 3\r\x1b[K\r\x1b[K{half}\r\x1b[K"
    assert terminal(quiet=True) is display(quiet=True) is None


def test_a_bar_on_a_terminal(clock, capsys, monkeypatch):
    pytest.importorskip("tqdm")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with Progress(terminal()) as line:
        clock.now += 10.0
        line.callback("head and mesh")
        for share in (0.25, 0.5):
            clock.now += 10.0
            line.callback(Step("continuous", share))
    out, err = capsys.readouterr()
    said = [part.strip() for part in err.split("\r") if part.strip()]
    assert not out and said[0] == "10 s  head and mesh"
    shown = [re.fullmatch(r"(\d+) %\|(.*)\|\s+(\d+) s  continuous", part) for part in said[1:]]
    shares = {(int(found[1]), int(found[3])): found[2].count("\u2588") for found in shown if found}
    assert set(shares) == {(25, 20), (50, 30)} and 0 < shares[25, 20] < shares[50, 30]
    assert err.endswith("\r") and not Progress._first


def test_a_short_work_leaves_the_terminal_alone(clock, capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with Progress(terminal()) as line:
        clock.now += 1.9
        line.callback("round 3")
    assert capsys.readouterr() == ("", "")


def test_of_two_within_each_other_the_outer_is_on_show(clock):
    outer, inner = [], []
    with Progress(lambda step, _: outer.append(step)) as first:
        with Progress(lambda step, _: inner.append(step)) as second:
            clock.now += 10.0
            second.callback("in it")
            first.callback("around it")
        assert Progress._first is first
    assert outer == [Step("around it"), None] and not inner


@pytest.fixture
def cell(monkeypatch):
    """A notebook's cell: what is displayed under it."""
    shown = []

    class DisplayHandle:
        def display(self, data, raw):
            shown.append(("display", data["text/plain"], raw))

        def update(self, data, raw):
            shown.append(("update", data["text/plain"], raw))

    kernel = types.SimpleNamespace(get_ipython=lambda: types.SimpleNamespace(kernel=None))
    monkeypatch.setitem(sys.modules, "IPython", kernel)
    monkeypatch.setitem(sys.modules, "IPython.display", types.SimpleNamespace(DisplayHandle=DisplayHandle))
    return shown


@pytest.mark.parametrize("lacking", ["tqdm", "ipywidgets"])
def test_a_line_under_a_cell(clock, cell, without, lacking):
    without(lacking)
    with Progress(notebook()) as line:
        for text in ("round 1", "round 2"):
            clock.now += 5.0
            line.callback(text)
    assert cell == [
        ("display", "   5 s  round 1", True),
        ("update", "  10 s  round 2", True),
        ("update", "", True),
    ]


def test_a_bar_under_a_cell(clock, cell, without, monkeypatch):
    bars = []

    class Bar:
        def __init__(self, total, desc, initial, bar_format, leave):
            self.total, self.desc, self.n, self.seen = total, desc, initial, []
            assert not leave and ("{bar}" in bar_format) == (total is not None)
            bars.append(self)

        def refresh(self):
            self.seen.append((self.desc, self.n))

        def close(self):
            self.seen.append(("closed", self.n))

    monkeypatch.setitem(sys.modules, "tqdm.auto", types.SimpleNamespace(tqdm=Bar))
    without()
    with Progress(display()) as line:
        for step in ("head and mesh", Step("continuous", 0.5), Step("staged", 0.75)):
            clock.now += 5.0
            line.callback(step)
    assert [bar.seen for bar in bars] == [
        [("   5 s  head and mesh", 0.0), ("closed", 0.0)],
        [("  10 s  continuous", 0.5), ("  15 s  staged", 0.75), ("closed", 1.0)],
    ]
    assert not cell


SCENE = Scene(
    geometry=Geometry(kind="block", size=(0.02, 0.02, 0.02)),
    tissues=[Tissue(mu=1000.0, poissons_ratio=0.3)],
    displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-4))],
    quantities=[Quantity(name="force", boundary="top", tolerance=0.5)],
)


def test_simulate_is_not_mute_in_a_notebook(cell, without, monkeypatch):
    without("tqdm")
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr(progress, "TICK", 0.01)
    before = threading.active_count()
    simulate(SCENE, richest={"mesh": "0"})
    assert len(cell) >= 2 and re.fullmatch(r" +\d+ s  .+", cell[0][1]) and cell[-1][1] == ""
    assert len({text for _, text, _ in cell}) > 2  # of several models
    cell.clear()
    simulate(SCENE, richest={"mesh": "0"}, callback=lambda *_: None)
    assert not cell and threading.active_count() <= before + 1


ON_A_TERMINAL = """
import sys, time
from ngbrain import cli, progress
from ngbrain.progress import Progress, terminal

progress.PATIENCE, progress.TICK = 0.0, 0.01
def run(arguments):
    with Progress(terminal(arguments.quiet), text="measuring") as line:
        time.sleep(0.2)
        line.callback(progress.Step("half", 0.5))
        time.sleep(0.2)
cli.import_module = lambda name: sys.modules["__main__"]
sys.exit(cli.main(["simulate", "x.toml", *sys.argv[1:]]))
"""


@pytest.mark.parametrize(("options", "shown"), [((), True), (("-q",), False)], ids=["", "-q"])
def test_a_command_on_a_terminal(options, shown):
    ours, theirs = pty.openpty()
    done = subprocess.run(
        [sys.executable, "-c", ON_A_TERMINAL, *options],
        stdout=subprocess.PIPE,
        stderr=theirs,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        check=True,
    )
    os.close(theirs)
    said = b""
    try:
        while found := os.read(ours, 1 << 16):
            said += found
    except OSError:  # Linux has nothing more at the end
        pass
    os.close(ours)
    assert not done.stdout
    assert (b"measuring" in said) == (b"50 %" in said) == shown, said


@pytest.mark.parametrize("shell", [None, types.SimpleNamespace()], ids=["no shell", "a shell on a terminal"])
def test_elsewhere_there_is_no_cell(monkeypatch, shell):
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    assert notebook() is None


def test_runs_say_what_is_left(clock):
    words = RunProgress(2)
    assert words("continuous", 0.0, 0.0) == Step("estimating  continuous t = 0.0 s", 0.0)
    clock.now += 10.0
    assert (
        str(words("continuous", 30.0, 0.5))
        == "[######..................]  25 %  about 30 s left  continuous t = 30.0 s"
    )
    clock.now += 10.0
    words("continuous", 60.0, 1.0)
    assert "about 20 s left" in str(words("staged", 0.0, 0.0))


def test_what_was_done_before_is_not_counted_as_speed(clock):
    words = RunProgress(1)
    words("continuous", 50.0, 0.5)
    clock.now += 10.0
    assert "75 %  about 10 s left" in str(words("continuous", 75.0, 0.75))


@reporting(lambda given: lambda name, rest: f"{name}, {given['rounds'] - rest} of {given['rounds']}")
def work(rounds, callback=log_progress):
    """Work long."""
    for i in range(rounds):
        callback("round", rounds - i - 1)
    return callback


def test_a_function_that_reports_by_itself(caplog, monkeypatch):
    kept = []
    monkeypatch.setattr(Progress, "__exit__", lambda self, *_: kept.append(self.text) or self._over.set())
    assert work(3) is not log_progress and kept == ["round, 3 of 3"] and work.__doc__ == "Work long."
    told = []
    assert work(rounds=2, callback=lambda *what: told.append(what)) and told == [("round", 1), ("round", 0)]
    assert len(kept) == 1


def test_functions_of_the_library_report():
    from ngbrain.inverse.elastography import invert, invert_3d
    from ngbrain.inverse.fitting import estimate
    from ngbrain.inverse.subzones import invert as subzones
    from ngbrain.ladder import solve
    from ngbrain.surgery import calibrate, model_selection, retraction
    from ngbrain.workflows.cohort import cohort

    for function in (
        solve, model_selection.solve, retraction.solve, calibrate.calibrate, invert.invert, invert_3d.invert_in_space,
        subzones.invert_by_subzones, estimate.estimate, cohort,
    ):  # fmt: skip
        assert inspect.signature(function).parameters["callback"].default is log_progress and hasattr(
            function, "__wrapped__"
        )


HALF_MINUTES = """
import sys, time
from ngbrain import cli, progress
from ngbrain.progress import Progress, terminal

progress.EVERY = 0.05
def run(arguments):
    with Progress(terminal(arguments.quiet), text="measuring") as line:
        time.sleep(0.3)
        progress.LOG.warning("it is cold")
cli.import_module = lambda name: sys.modules["__main__"]
sys.exit(cli.main(["simulate", "x.toml", *sys.argv[1:]]))
"""


@pytest.mark.parametrize(("options", "lines"), [((), True), (("-q",), False)], ids=["", "-q"])
def test_where_stderr_is_no_terminal_there_are_lines(options, lines):
    done = subprocess.run(
        [sys.executable, "-c", HALF_MINUTES, *options],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        check=True,
    )
    said = done.stderr.splitlines()
    said.remove("ngbrain: it is cold")
    assert not done.stdout
    assert bool(said) == lines and all(line == "ngbrain:    0 s  measuring" for line in said)
