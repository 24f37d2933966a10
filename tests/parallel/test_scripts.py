"""Scripts of any kind compute side by side: without a main guard, from stdin, in a thread. Ctrl-C ends all that they started."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1]
PLAIN = """
from parallel_tasks import lives
from ngbrain import parallel

print("this script is run once")
print(parallel.run([("a", lives, (1,)), ("b", lives, (2,))], 2))
"""
THREADED = """
import threading
from parallel_tasks import lives
from ngbrain import parallel

print("this script is run once")
thread = threading.Thread(target=lambda: print(parallel.run([("a", lives, (1,)), ("b", lives, (2,))], 2)))
thread.start()
"""
OWN = """
import os
from ngbrain import parallel

def work(*, callback):
    return os.getpid()

found = parallel.run([("a", work, ()), ("b", work, ())], 2)
print(set(found.values()) == {os.getpid()})
"""
UNPICKLED = """
from parallel_tasks import raises
from ngbrain import parallel

try:
    parallel.run([("a", raises, (open(0),)), ("b", raises, (open(0),))], 2)
except TypeError as error:
    print(error)
"""
LONG = """
import signal, sys, threading
from concurrent.futures import ThreadPoolExecutor
from parallel_tasks import ticks, waits
import ngsolve  # whose import, when it is interrupted, reports errors of its own
from ngbrain import parallel
from ngbrain.mesh import block
from ngbrain.parallel import driver, processes

how = sys.argv[1] if sys.argv[1:] else ""
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a shell begins without

def compute():
    if how == "serial thread":
        parallel.run([("a", ticks, (60,))], 1)
    tasks = [("a", waits, (60,)), ("b", waits, (60,))][: 1 if how == "deaf" else 2]
    parallel.run(tasks, 2, callback=lambda pid: print(pid, flush=True))

print("begun", flush=True)
if how.endswith("thread"):
    thread = threading.Thread(target=compute)
    thread.start()
    thread.join()
elif how == "executor":
    with ThreadPoolExecutor() as executor:
        executor.submit(compute).result()
else:
    compute()
"""


def environment():
    return os.environ | {"PYTHONPATH": f"{HERE}{os.pathsep}{HERE.parent}", "OPENBLAS_NUM_THREADS": "1"}


def python(*arguments, **more):
    return subprocess.run(
        [sys.executable, *map(str, arguments)], capture_output=True, text=True, timeout=120, env=environment(), **more
    )


@contextlib.contextmanager
def started(*arguments):
    """A script under way, in a process group of its own as a terminal would give it."""
    process = subprocess.Popen(
        [sys.executable, "-c", LONG, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        start_new_session=True,
    )
    try:
        assert process.stdout.readline() == "begun\n"
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def group(number):
    """Processes that are alive in a process group."""
    alive = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, _, its_group = stat.read_text().rpartition(")")[2].split()[:3]
            if int(its_group) == number and state != "Z":
                alive.append(int(stat.parent.name))
    return alive


def gone(number, seconds=10.0):
    """Whether nothing is left of a process group in time."""
    until = time.monotonic() + seconds
    while alive := group(number):
        if time.monotonic() > until:
            return not alive
        time.sleep(0.05)
    return True


@pytest.mark.parametrize("script", [PLAIN, THREADED], ids=["plain", "in a thread"])
@pytest.mark.parametrize("way", ["file", "stdin", "-c"])
def test_a_script_without_a_main_guard(tmp_path, script, way):
    if way == "file":
        (tmp_path / "script.py").write_text(script)
        done = python(tmp_path / "script.py")
    else:
        done = python("-", input=script) if way == "stdin" else python("-c", script)
    assert done.stdout == "this script is run once\n{'a': 1, 'b': 2}\n" and done.returncode == 0 and not done.stderr


@pytest.mark.parametrize(
    ("script", "said", "why"),
    [
        (OWN, "True\n", "another process cannot read the tasks (AttributeError"),
        (
            UNPICKLED,
            "exceptions must derive from BaseException\n",
            "tasks cannot be sent to another process (TypeError",
        ),
    ],
    ids=["a function of the script", "an open file"],
)
def test_what_cannot_be_sent_is_computed_here(tmp_path, script, said, why):
    (tmp_path / "script.py").write_text(script)
    done = python(tmp_path / "script.py")
    assert done.returncode == 0 and done.stdout == said
    (line,) = done.stderr.splitlines()
    assert line.startswith(why) and line.endswith("is computed in this process, one after the other")


def test_where_no_process_can_be_started(tmp_path):
    done = python("-c", "import sys; sys.executable = '/nowhere'\n" + PLAIN)
    assert done.stdout == "this script is run once\n{'a': 1, 'b': 2}\n" and done.returncode == 0
    assert done.stderr.startswith("no other process can be started (No such file or directory)")


@pytest.mark.parametrize("closed", ["2>&-", "<&- 2>&-"])
def test_without_standard_streams(closed):
    """A pipe of the first process that is started must not become the stderr of the second."""
    script = PLAIN.replace("lives\n", "lives, prints\n").replace("lives, (1,)", "prints, ()")
    done = subprocess.run(
        ["sh", "-c", f'"$0" -c "$1" {closed}', sys.executable, script], capture_output=True, env=environment()
    )
    assert done.returncode == 0 and done.stdout == b"this script is run once\n{'a': None, 'b': 2}\n"


def test_a_task_that_is_killed_twice_is_two_lines():
    with started("deaf") as process:
        for _ in range(2):
            os.kill(int(process.stdout.readline()), signal.SIGKILL)
        warning, *_, error = process.communicate(timeout=60)[1].splitlines()
        assert process.returncode == 1 and gone(process.pid)
    assert warning.startswith("a: its process died (signal 9)") and "tried again" in warning
    assert error.startswith("ngbrain.parallel.tasks.TaskLost: a: its process died (signal 9)")


def test_a_process_that_is_killed_while_it_starts_is_replaced():
    with started() as process:
        while len(alive := group(process.pid)) < 2:
            time.sleep(0.005)
        os.kill(max(alive), signal.SIGKILL)
        pids = [int(process.stdout.readline()) for _ in range(2)]
        assert max(alive) not in pids and len(set(pids)) == 2


def test_processes_end_with_their_parent():
    with started() as process:
        for _ in range(2):
            process.stdout.readline()
        os.kill(process.pid, signal.SIGKILL)
        assert gone(process.pid)


MOMENTS = random.Random(1)
SEVERAL = [MOMENTS.uniform(0, 1) for _ in range(3)] + [MOMENTS.uniform(1, 4)]


def interrupted(process, moment, everybody, twice=False):
    """After Ctrl-C, as a terminal (to every process) or `kill -INT` (to one) sends it."""
    time.sleep(moment)
    for _ in range(1 + twice):
        with contextlib.suppress(ProcessLookupError):
            (os.killpg if everybody else os.kill)(process.pid, signal.SIGINT)
        time.sleep(0.02)
    error = process.communicate(timeout=60)[1]
    assert process.returncode == -signal.SIGINT and gone(process.pid, 5.0)
    return error


@pytest.mark.parametrize(
    ("where", "everybody"),
    [
        ("main", True),
        ("main", False),
        ("thread", True),
        ("thread", False),
        ("executor", True),
        ("serial thread", False),
    ],
    ids=[
        "Ctrl-C",
        "kill -INT",
        "Ctrl-C in a thread",
        "kill -INT in a thread",
        "Ctrl-C in an executor's thread",
        "kill -INT beside one process",
    ],
)
@pytest.mark.parametrize("moment", [SEVERAL[0], pytest.param(SEVERAL[1], marks=pytest.mark.slow), SEVERAL[3]])
def test_ctrl_c_ends_everything(moment, where, everybody):
    with started(where) as process:
        error = interrupted(process, moment, everybody)
    assert error.rstrip().endswith("KeyboardInterrupt") and "BrokenPipe" not in error and "SolverError" not in error
    if where == "main":
        assert error.count("Traceback") == 1, error


@pytest.mark.slow
@pytest.mark.parametrize("where", ["main", "thread", "executor"])
@pytest.mark.parametrize("moment", SEVERAL)
def test_ctrl_c_twice_ends_everything(moment, where):
    with started(where) as process:
        interrupted(process, moment, True, twice=True)
