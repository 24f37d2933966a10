"""Tasks in processes: answers by name; one whose process dies is named."""

import pytest
from dying import dies, lives, outlives

from ngbrain import pool
from ngbrain.errors import SolverError


@pytest.mark.parametrize("workers", [1, 2])
def test_answers_by_name(workers):
    assert pool.run([("a", lives, (1,)), ("b", lives, (2,))], workers) == {"a": 1, "b": 2}


def test_the_task_whose_process_dies_is_named():
    with pytest.raises(SolverError, match=r"^the second: its process died \(signal 9\).*memory"):
        pool.run([("the first", lives, (1,)), ("the second", dies, ())], 2)


def test_the_last_task_gets_the_threads_that_are_left():
    found = pool.run([("short", outlives, (0.0,)), ("long", outlives, (3.0,))], 2)
    assert found["long"][1] == 2  # whatever it saw beside the other


def test_one_process_has_one_thread():
    assert pool.run([("short", lives, (1,)), ("long", outlives, (0.0,))], 1)["long"] == [1, 1]
