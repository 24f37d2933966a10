"""How far work has come: on a terminal a line, in a notebook a line, and a record every half minute."""

import inspect
import logging
import os
import subprocess
import sys
import types
from pathlib import Path

import pytest

from ngbrain.progress import Progress, RunProgress, log_progress, notebook, reporting, terminal


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

        return types.SimpleNamespace(wait=wait, set=lambda: None)


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def test_a_record_every_half_minute(clock, caplog):
    caplog.set_level(logging.INFO, "ngbrain")
    line = Progress(text="reading")
    line._over = clock.over_after(100.0, lambda now: line.callback("round 2") if now == 60.0 else None)
    line._log()
    assert [record.getMessage() for record in caplog.records] == [
        "  30 s  reading",
        "  60 s  round 2",
        "  90 s  round 2",
    ]
    assert {(record.name, record.levelname) for record in caplog.records} == {("ngbrain", "INFO")}


def test_a_line_of_a_terminal(clock, capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with Progress(terminal()) as line:
        line.callback("too soon")
        clock.now += 10.0
        line.callback("round 3")
        clock.now += 0.01
        line.callback("too soon after it")
        line.say("what stays")
    out, err = capsys.readouterr()
    assert out == "what stays\n" and err == "\r\x1b[K  10 s  round 3\r\x1b[K\r\x1b[K"
    assert terminal(quiet=True) is None


def test_a_short_work_leaves_the_terminal_alone(clock, capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with Progress(terminal()) as line:
        clock.now += 1.9
        line.callback("round 3")
    assert capsys.readouterr() == ("", "")


def test_a_line_under_a_cell(clock, monkeypatch):
    shown = []

    class DisplayHandle:
        def display(self, data, raw):
            shown.append(("display", data["text/plain"], raw))

        def update(self, data, raw):
            shown.append(("update", data["text/plain"], raw))

    kernel = types.SimpleNamespace(get_ipython=lambda: types.SimpleNamespace(kernel=None))
    monkeypatch.setitem(sys.modules, "IPython", kernel)
    monkeypatch.setitem(sys.modules, "IPython.display", types.SimpleNamespace(DisplayHandle=DisplayHandle))
    with Progress(notebook()) as line:
        for text in ("round 1", "round 2"):
            clock.now += 5.0
            line.callback(text)
    assert shown == [
        ("display", "   5 s  round 1", True),
        ("update", "  10 s  round 2", True),
        ("update", "", True),
    ]


@pytest.mark.parametrize("shell", [None, types.SimpleNamespace()], ids=["no shell", "a shell on a terminal"])
def test_elsewhere_there_is_no_cell(monkeypatch, shell):
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    assert notebook() is None


def test_runs_say_what_is_left(clock):
    words = RunProgress(2)
    assert "estimating" in words("continuous", 0.0, 0.0)
    clock.now += 10.0
    assert words("continuous", 30.0, 0.5) == "[######..................]  25 %  about 30 s left  continuous t = 30.0 s"
    clock.now += 10.0
    words("continuous", 60.0, 1.0)
    assert "about 20 s left" in words("staged", 0.0, 0.0)


def test_what_was_done_before_is_not_counted_as_speed(clock):
    words = RunProgress(1)
    words("continuous", 50.0, 0.5)
    clock.now += 10.0
    assert "75 %  about 10 s left" in words("continuous", 75.0, 0.75)


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

    for function in (
        solve, model_selection.solve, retraction.solve, calibrate.calibrate, invert.invert, invert_3d.invert_in_space,
        subzones.invert_by_subzones, estimate.estimate,
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
