"""Tasks in processes: answers by name; one whose process dies is named."""

import signal
import threading
import time

import numpy as np
import pytest
from parallel_tasks import (
    adds,
    counts,
    dies,
    dies_once,
    exhausts,
    exhausts_once,
    exits,
    interrupted,
    lives,
    outlives,
    prints,
    raises,
    raises_particularly,
    waits,
    works,
    works_alone,
)

from ngbrain import parallel
from ngbrain.errors import InputError, SolverError
from ngbrain.io import FinishedWork
from ngbrain.parallel import kernel, processes


@pytest.fixture(scope="module")
def two():
    """Processes that several tests share, as starting them takes a second."""
    with parallel.ProcessExecutor(2) as executor:
        yield executor


@pytest.fixture(params=[1, 2])
def workers(request):
    """This process, or two others."""
    return 1 if request.param == 1 else request.getfixturevalue("two")


def test_answers_by_name(workers):
    assert parallel.run([("a", lives, (1,)), ("b", lives, (2,))], workers) == {"a": 1, "b": 2}


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


def test_the_task_whose_process_dies_twice_is_named(two, caplog):
    with pytest.raises(parallel.TaskLost, match=r"^the second: its process died \(signal 9\).*memory"):
        parallel.run([("the first", lives, (1,)), ("the second", dies, ())], two)
    (line,) = caplog.messages
    assert line.startswith("the second: its process died (signal 9)") and "; it is tried again" in line


def test_the_last_task_gets_the_threads_that_are_left():
    with parallel.ProcessExecutor(2, threads=2) as executor:
        found = parallel.run([("short", outlives, (0.0,)), ("long", outlives, (3.0,))], executor)
    assert found["long"][1] == 2  # whatever it saw beside the other


@pytest.mark.one_thread
def test_without_threads_to_share_the_last_task_has_one_too(two):
    assert parallel.run([("short", lives, (1,)), ("long", outlives, (0.5,))], two)["long"] == [1, 1]


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
def test_other_ways_to_fail_are_one_line_too(task, words, two):
    with pytest.raises(SolverError, match=words):
        parallel.run([("the first", lives, (1,)), ("the second", task, ())], two)


def test_an_exception_comes_back_as_it_was_and_says_where_from(two):
    with pytest.raises(InputError, match="nose is 3; wanted: one"):
        parallel.run([("the first", lives, (1,)), ("the second", raises, (InputError("nose", 3, "one"),))], two)
    with pytest.raises(ZeroDivisionError) as caught:
        parallel.run([("the first", raises, (ZeroDivisionError("by nothing"),))], two)
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


def test_it_is_said_when_a_task_has_ended_and_what_it_told(workers):
    said, ended = [], {}
    parallel.run([("a", lives, (1,)), ("b", lives, (2,))], workers, callback=said.append, finished=ended.__setitem__)
    assert said == ["alive", "alive"] and ended == {"a": 1, "b": 2}


def test_who_listens_may_end_it(two):
    def listen(_):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        parallel.run([("a", outlives, (60.0,)), ("b", lives, (2,))], two, callback=listen)


def test_a_task_is_called_with_what_it_needs(workers):
    tasks = [
        parallel.Task("one", lives, (1,)),
        parallel.Task("two", lives, (2,)),
        parallel.Task("sum", adds, (), ["one", "two"]),
        parallel.Task("more", adds, (10,), ["sum"]),
    ]
    assert parallel.run(tasks, workers) == {"one": 1, "two": 2, "sum": 3, "more": 13}


def test_an_exception_in_place_of_a_result_ends_only_what_needs_it(workers):
    tasks = [
        parallel.Task("bad", raises, (InputError("nose", 3, "one"),)),
        parallel.Task("of it", adds, (1,), ["bad"]),
        parallel.Task("good", lives, (1,)),
    ]
    ended = []
    found = parallel.run(tasks, workers, on_error="return", finished=lambda name, _: ended.append(name))
    assert list(found) == ["bad", "of it", "good"] == sorted(ended, key=list(found).index)
    assert isinstance(found["bad"], InputError) and found["bad"].field == "nose" and found["good"] == 1
    assert str(found["of it"]) == "of it: it needs bad, which failed"


def test_a_killed_task_is_tried_once_more_and_found(two, tmp_path, caplog):
    tasks = [("killer", dies_once, (tmp_path, 3))] + [(f"task {i}", counts, (tmp_path, i)) for i in range(3)]
    found = parallel.run(tasks, two)
    assert [list(values) for values in found.values()] == [[0, 3, 6], [0, 0, 0], [0, 1, 2], [0, 2, 4]]
    assert sorted(path.name[0] for path in tmp_path.iterdir()) == ["0", "1", "2", "3", "3"]
    (line,) = caplog.messages
    assert line.startswith("killer: its process died (signal 9)") and "it is tried again" in line


def test_what_memory_was_short_for_is_tried_alone(two, tmp_path, caplog):
    tasks = [("large", exhausts_once, (tmp_path,)), ("short", works, (tmp_path, 0.3)), ("long", works, (tmp_path, 2.0))]
    assert parallel.run(tasks, two)["large"] == []
    assert caplog.messages == ["large: out of memory; fewer at once take less; it is tried again, alone"]


@pytest.mark.parametrize(
    ("kills", "words", "memory"),
    [
        ([3, 3], "killed by another process: memory was not the reason", False),
        ([3, 4], "the system ended it for want of memory; fewer at once take less", True),
        ([None, None], "was there memory enough", True),
    ],
)
def test_the_cause_of_a_kill_is_what_the_system_counts(kills, words, memory, monkeypatch):
    monkeypatch.setattr(processes, "memory_kills", lambda: kills.pop(0))
    with parallel.ProcessExecutor(1) as executor, pytest.raises(parallel.TaskLost, match=words) as caught:
        executor.submit_task("a", dies, (), print).result()
    assert caught.value.memory == memory


def test_a_task_can_be_killed_while_its_process_starts(monkeypatch):
    """Or Ctrl-C at that moment would wait for the whole task."""
    starting, killed, popen = threading.Event(), threading.Event(), processes.Popen

    def slow_start(*args, **kwargs):
        starting.set()
        assert killed.wait(60)
        return popen(*args, **kwargs)

    monkeypatch.setattr(processes, "Popen", slow_start)
    with parallel.ProcessExecutor(1) as executor:
        job = executor.submit_task("a", waits, (300,), print)
        assert starting.wait(60)
        job.kill()
        killed.set()
        with pytest.raises(parallel.TaskLost, match="a: its process died"):
            job.result(timeout=60)


def test_kills_for_memory_are_counted_where_the_system_does():
    count = kernel.memory_kills()
    assert count is None or count >= 0
    assert 2**28 < kernel.machine_memory() < 2**50


def test_what_cannot_fit_is_refused_before_anything_begins(workers, tmp_path):
    huge = 3 * kernel.machine_memory()
    tasks = [parallel.Task("small", counts, (tmp_path, 1)), parallel.Task("huge", counts, (tmp_path, 2), memory=huge)]
    words = rf"^memory of huge is {huge / 2**30:.1f} GiB; wanted: at most {huge / 2**30 / 3:.1f} GiB"
    with pytest.raises(InputError, match=words):
        parallel.run(tasks, workers)
    assert not list(tmp_path.iterdir())
    found = parallel.run(tasks, workers, on_error="return")
    assert found["small"][1] == 1.0 and isinstance(found["huge"], InputError)


def test_what_does_not_fit_beside_another_waits(two, tmp_path):
    most = 0.7 * kernel.machine_memory()
    tasks = [parallel.Task(f"{i}", works_alone, (tmp_path,), memory=most) for i in range(3)]
    assert list(parallel.run(tasks, two).values()) == [1, 1, 1]


def test_finished_work_is_not_done_again(workers, tmp_path):
    work = FinishedWork(tmp_path / "kept")
    (tmp_path / "begun").mkdir()
    tasks = [parallel.Task(f"task {i}", counts, (tmp_path / "begun", i)) for i in range(2)]
    tasks.append(parallel.Task("sum", adds, (), ["task 0", "task 1"]))
    first = parallel.run(tasks, workers, store=work)
    ended = []
    second = parallel.run(tasks, workers, store=work, finished=lambda name, _: ended.append(name))
    assert ended == list(first) == list(second) and len(list((tmp_path / "begun").iterdir())) == 2
    assert all(np.array_equal(first[name], second[name]) for name in first)
    for path in (tmp_path / "kept").iterdir():
        path.write_bytes(path.read_bytes()[:-7])
    parallel.run(tasks, workers, store=work)
    assert len(list((tmp_path / "begun").iterdir())) == 4


def test_errors_are_not_finished_work(tmp_path):
    work, bad = FinishedWork(tmp_path), [("bad", raises, (InputError("nose", 3, "one"),))]
    with pytest.raises(InputError, match=r"what raises is called with\[0\] is a InputError"):
        parallel.run(bad, store=work)
    assert parallel.run([("bad", exhausts_once, (tmp_path / "none",))], on_error="return", store=work)
    assert not list(tmp_path.glob("*.npz"))


def test_tasks_that_make_no_sense():
    with pytest.raises(InputError, match=r"^tasks is of one name, 'a'"):
        parallel.run([("a", lives, (1,)), ("b", lives, (1,)), ("a", lives, (2,))])
    with pytest.raises(InputError, match=r"^what a needs is 'b'; wanted: the name of a task before it"):
        parallel.run([parallel.Task("a", adds, (1,), ["b"]), parallel.Task("b", lives, (1,))])
    with pytest.raises(InputError, match=r"^executor is 0"):
        parallel.run([("a", lives, (1,))], 0)


def test_the_interface_of_an_executor():
    with parallel.ProcessExecutor(2) as executor:
        assert list(executor.map(divmod, [7, 9], [2, 4])) == [(3, 1), (2, 1)]
        future = executor.submit(int, "12", base=3)
        assert future.result() == 5 and future.done()
        with pytest.raises(ZeroDivisionError):
            executor.submit(divmod, 1, 0).result()
        slow, waiting = [executor.submit(time.sleep, 0.5) for _ in range(2)], executor.submit(abs, -1)
        assert waiting.cancel() and [each.result() for each in slow] == [None, None]
    with pytest.raises(RuntimeError, match="shut down"):
        executor.submit(abs, 1)
