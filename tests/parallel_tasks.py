"""Tasks for `ngbrain.parallel`, importable by the processes that it starts, in a moment: NGSolve is imported where it is used."""

import os
import resource
import signal
import time

import numpy as np

from ngbrain import parallel


def lives(answer, *, callback):
    callback("alive")
    return answer


def dies(*, callback):
    os.kill(os.getpid(), signal.SIGKILL)


def interrupted(*, callback):
    """By Ctrl-C, which every process of a terminal hears."""
    os.kill(os.getpid(), signal.SIGINT)


def outlives(seconds, *, callback):
    """Threads at first, and when there has been time for the other tasks to end."""
    import ngsolve as ngs

    seen = []
    with parallel.share_threads(callback) as told:
        for wait in (0.0, seconds):
            time.sleep(wait)
            told("still here")
            seen.append(ngs.ngsglobals.numthreads)
    return seen


def waits(seconds, *, callback):
    """Where a process stands still for long."""
    callback(os.getpid())
    time.sleep(seconds)


def ticks(seconds, *, callback):
    """It tells all the time."""
    for _ in range(int(10 * seconds)):
        callback(os.getpid())
        time.sleep(0.1)


def exits(*, callback):
    os._exit(7)


def exhausts(*, callback):
    """Memory, of which there is little."""
    resource.setrlimit(resource.RLIMIT_AS, (2**31, 2**31))
    bytearray(2**32)


class Particular(Exception):
    """One that no pickle brings back."""

    def __init__(self, what, why):
        super().__init__(f"{what} {why}")


def raises(error, *, callback):
    raise error


def raises_particularly(*, callback):
    raise Particular("out", "of order")


def prints(*, callback):
    print("from a task")
    os.write(1, b"and from below\n")


def points(*, callback):
    """Of a mesh that is made there."""
    from ngbrain.mesh import block

    mesh = block((0.1, 0.2, 0.3), 0.1)  # its coordinates are gone with it
    return mesh.ngmesh.Coordinates().copy()


def counts(folder, number, *, callback):
    """It leaves a file of a name of its own each time that it is begun."""
    (folder / f"{number} begun {os.getpid()} {time.monotonic_ns()}").touch()
    return number * np.arange(3.0)


def dies_once(folder, number, *, callback):
    """The process, in the middle, but not the second time."""
    counts(folder, number, callback=callback)
    if len(list(folder.glob(f"{number} begun *"))) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * np.arange(3.0)


def exhausts_once(folder, *, callback):
    """Memory, in the first process; the second time it says what runs beside it."""
    (folder / f"exhausts {time.monotonic_ns()}").touch()
    if len(list(folder.glob("exhausts *"))) == 1:
        raise MemoryError
    return sorted(path.name for path in folder.glob("at work *"))


def works(folder, seconds, *, callback):
    """For a while, which a file says."""
    mark = folder / f"at work {os.getpid()}"
    mark.touch()
    time.sleep(seconds)
    mark.unlink()


def works_alone(folder, *, callback):
    """How many such are at work, with this one."""
    mark = folder / f"at work {os.getpid()}"
    mark.touch()
    time.sleep(0.5)
    number = len(list(folder.glob("at work *")))
    mark.unlink()
    return number


def adds(one, other, *, callback):
    """What others have found."""
    return one + other


def writes_and_dies_once(folder, number, *, callback):
    """It writes its result as a script of one's own would, into a table, and its process dies before anybody hears of it."""
    with (folder / "table.csv").open("a") as table:
        table.write(f"{number},{number**2}\n")
    if len((folder / "table.csv").read_text().splitlines()) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return np.array([number, number**2])
