"""Tasks in processes: answers by name; one whose process dies is named."""

import signal

import pytest
from dying import dies, exhausts, exits, interrupted, lives, outlives, prints, raises, raises_particularly

from ngbrain import parallel
from ngbrain.errors import InputError, SolverError


@pytest.mark.parametrize("workers", [1, 2])
def test_answers_by_name(workers):
    assert parallel.run([("a", lives, (1,)), ("b", lives, (2,))], workers) == {"a": 1, "b": 2}


@pytest.mark.parametrize("workers", [1, 2])
def test_results_are_heard_of_as_they_come(workers):
    heard, asked = [], []
    tasks = [("a", lives, (1,)), ("b", lives, (2,))]
    parallel.run(tasks, workers, finished=lambda name, result: heard.append((name, result)) or asked.append(len(heard)))
    assert sorted(heard) == [("a", 1), ("b", 2)] and asked == [1, 2]


def test_what_is_raised_on_hearing_ends_the_tasks():
    def stop(name, result):
        raise KeyboardInterrupt

    for workers in (1, 2):
        with pytest.raises(KeyboardInterrupt):
            parallel.run([("a", lives, (1,)), ("b", outlives, (60.0,))], workers, finished=stop)


def test_the_task_whose_process_dies_twice_is_named(caplog):
    with pytest.raises(parallel.TaskLost, match=r"^the second: its process died \(signal 9\).*memory"):
        parallel.run([("the first", lives, (1,)), ("the second", dies, ())], 2)
    (line,) = caplog.messages
    assert line.startswith("the second: its process died (signal 9)") and "; it is tried again" in line


def test_the_last_task_gets_the_threads_that_are_left():
    with parallel.ProcessExecutor(2, threads=2) as executor:
        found = parallel.run([("short", outlives, (0.0,)), ("long", outlives, (3.0,))], executor)
    assert found["long"][1] == 2  # whatever it saw beside the other


@pytest.mark.one_thread
def test_one_process_has_one_thread():
    assert parallel.run([("short", lives, (1,)), ("long", outlives, (0.0,))], 1)["long"] == [1, 1]


@pytest.mark.parametrize(
    ("task", "words"),
    [
        (exits, r"^the second: its process died \(status 7\)"),
        (exhausts, "^the second: out of memory; fewer at once take less$"),
        (raises_particularly, "^the second: Particular: out of order$"),
    ],
)
def test_other_ways_to_fail_are_one_line_too(task, words):
    with pytest.raises(SolverError, match=words):
        parallel.run([("the first", lives, (1,)), ("the second", task, ())], 2)


def test_an_exception_comes_back_as_it_was_and_says_where_from():
    with pytest.raises(InputError, match="nose is 3; wanted: one"):
        parallel.run([("the first", lives, (1,)), ("the second", raises, (InputError("nose", 3, "one"),))], 2)
    with pytest.raises(ZeroDivisionError) as caught:
        parallel.run([("the first", raises, (ZeroDivisionError("by nothing"),))], 2)
    assert "raise error" in caught.value.__notes__[0]


def test_ctrl_c_that_only_a_task_heard_is_one():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a shell begins without
    try:
        with pytest.raises(KeyboardInterrupt):
            parallel.run([("the first", interrupted, ()), ("the second", outlives, (60.0,))], 2)
    finally:
        signal.signal(signal.SIGINT, before)


def test_what_a_task_prints_is_no_answer(capfd):
    assert parallel.run([("the first", prints, ()), ("the second", lives, (2,))], 2)["the second"] == 2
    assert capfd.readouterr().err == "from a task\nand from below\n"


@pytest.mark.parametrize("workers", [1, 2])
def test_it_is_said_when_a_task_has_ended_and_what_it_told(workers):
    said, ended = [], {}
    parallel.run([("a", lives, (1,)), ("b", lives, (2,))], workers, tell=said.append, finished=ended.__setitem__)
    assert said == ["alive", "alive"] and ended == {"a": 1, "b": 2}


def test_who_listens_may_end_it():
    def listen(_):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        parallel.run([("a", outlives, (60.0,)), ("b", lives, (2,))], 2, tell=listen)
