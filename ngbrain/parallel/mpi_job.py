"""Ranks of an MPI job as an executor: `mpiexec` starts them, `mpi4py.futures` distributes the work.

The job is a child of this process, which is not a rank itself: when one rank dies, MPI ends all ranks, and this process reports
it.
"""

from __future__ import annotations

import itertools
import os
import pickle
import re
import secrets
import shutil
import socket
import sys
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from contextlib import suppress
from functools import partial
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection, Listener
from pathlib import Path
from subprocess import PIPE, STDOUT, Popen, TimeoutExpired
from tempfile import TemporaryDirectory
from typing import Any

from ngbrain.errors import InputError, SolverError, require
from ngbrain.parallel.remote import call_name

_KEY = "NGBRAIN_MPI_KEY"
_SERVE = "import sys; from ngbrain.parallel.mpi_job import serve; serve(sys.argv[1])"
PATIENCE, FAREWELL = 60.0, 5.0
"""Time-outs (s) for the start and for the end of the ranks."""
_REASON = re.compile(r"EXIT STRING: (.*)")


class MpiExecutor(Executor):
    """Executor on the ranks of an MPI job, with one more rank that distributes the work.

    Parameters
    ----------
    workers : int
        Number of computing ranks.

    Raises
    ------
    MissingExtra
        mpi4py is not installed.
    InputError
        There is no `mpiexec`, or it starts no ranks.
    """

    def __init__(self, workers: int) -> None:
        require("mpi4py", "mpi")
        beside = Path(sys.executable).with_name("mpiexec")
        mpiexec = str(beside) if beside.exists() else shutil.which("mpiexec")
        if mpiexec is None:
            raise InputError(
                "executor", "mpi, and no mpiexec is found", 'one on the PATH, as pip install "ngbrain[mpi]" brings'
            )
        self.workers = workers
        self._over = False
        self._numbers, self._pending = itertools.count(), dict[int, tuple[str, Future[Any]]]()
        self._lock, self._ended, self._complaint = threading.Lock(), False, list[str]()
        self._folder = TemporaryDirectory(prefix="ngbrain-mpi-")
        key = secrets.token_hex(16)
        address = f"{self._folder.name}/socket"
        environment = os.environ | {_KEY: key, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        command = [mpiexec, "-n", str(workers + 1), sys.executable, "-m", "mpi4py.futures", "-c", _SERVE, address]
        try:
            with Listener(address, "AF_UNIX", authkey=key.encode()) as listener:
                self._process = Popen(
                    command, stdout=PIPE, stderr=STDOUT, text=True, env=environment, start_new_session=True
                )
                self._relay = threading.Thread(target=self._pass_on, daemon=True)
                self._relay.start()
                self._connection = self._accept(listener, address)
        except BaseException:
            self._folder.cleanup()
            raise
        threading.Thread(target=self._listen, daemon=True).start()

    def _accept(self, listener: Listener, address: str) -> Connection:
        """Accept the connection of the distributing rank, unless the job ends before."""

        def unblock() -> None:
            self._process.wait()
            with suppress(OSError), socket.socket(socket.AF_UNIX) as poke:
                poke.connect(address)

        threading.Thread(target=unblock, daemon=True).start()
        timer = threading.Timer(PATIENCE, self._process.kill)
        timer.start()
        try:
            return listener.accept()
        except (OSError, EOFError, AuthenticationError) as error:
            self._leave()
            said = next(iter(self._complaint), "nothing")
            wanted = f"an mpiexec that starts {self.workers + 1} ranks within {PATIENCE:.0f} s; it said: {said}"
            raise InputError("executor", "mpi, whose ranks do not start", wanted) from error
        finally:
            timer.cancel()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a call; all pending futures raise `SolverError` if a rank dies."""
        future = Future[Any]()
        sent = pickle.dumps((fn, args, kwargs))
        with self._lock:
            if self._ended:
                future.set_exception(self._end_of_the_job(call_name(fn, args)))
                return future
            number = next(self._numbers)
            self._pending[number] = call_name(fn, args), future
        with suppress(OSError):  # the job has ended; `_listen` handles it
            self._connection.send((number, sent))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the job.

        Parameters
        ----------
        wait : bool, optional
            Whether to wait for pending calls.
        cancel_futures : bool, optional
            Whether to cancel calls that have not started.
        """
        with self._lock:
            left = [future for _, future in self._pending.values()]
        for future in left:
            if not (cancel_futures and future.cancel()) and wait:
                with suppress(CancelledError):
                    future.exception()
        self._over = True
        if all(future.done() and not future.cancelled() for future in left):
            with suppress(OSError):
                self._connection.send(None)
            with suppress(TimeoutExpired):
                self._process.wait(FAREWELL)
        self._connection.close()
        self._leave()
        self._folder.cleanup()

    def _leave(self) -> None:
        """Terminate the job."""
        self._process.terminate()
        self._process.wait()
        self._relay.join(FAREWELL)

    def _listen(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                number, sent = self._connection.recv()
                with self._lock:
                    _, future = self._pending.pop(number)
                if future.set_running_or_notify_cancel():
                    well, what = pickle.loads(sent)
                    future.set_result(what) if well else future.set_exception(what)
        self._process.wait()
        self._relay.join(1.0)
        with self._lock:
            self._ended = True
            left = list(self._pending.values())
            self._pending.clear()
        for name, future in left:
            if future.set_running_or_notify_cancel():
                future.set_exception(self._end_of_the_job(name))

    def _end_of_the_job(self, name: str) -> SolverError:
        found = _REASON.search("\n".join(self._complaint))
        why = f"a rank died: {found[1].strip()}" if found else f"mpiexec ended with status {self._process.returncode}"
        return SolverError(f"{name}: {why}, which ends the MPI job; a restart continues from the finished tasks")

    def _pass_on(self) -> None:
        """Pass the output of the ranks on to stderr, without mpiexec's error report."""
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                if self._complaint or line.startswith("=====") or "error" in line.lower():
                    self._complaint.append(line.strip())
                elif line.strip() and not self._over:
                    sys.stderr.write(line)


def rank_count() -> int:
    """Number of available ranks: those of the Slurm allocation, or one per core."""
    return int(os.environ.get("SLURM_NTASKS", 0)) or os.cpu_count() or 1


def serve(address: str) -> None:
    """Main loop of the distributing rank: pass calls from the socket to the other ranks, and results back."""
    from mpi4py.futures import MPIPoolExecutor

    lock = threading.Lock()
    with (
        Client(address, "AF_UNIX", authkey=os.environ[_KEY].encode()) as connection,
        MPIPoolExecutor(main=False) as executor,
    ):

        def send(number: int, future: Future[bytes]) -> None:
            with lock:
                connection.send((number, future.result()))

        with suppress(EOFError):
            while (asked := connection.recv()) is not None:
                number, sent = asked
                executor.submit(answer, sent).add_done_callback(partial(send, number))


def answer(sent: bytes) -> bytes:
    """Compute a pickled call in a rank, and pickle its result or exception."""
    try:
        fn, args, kwargs = pickle.loads(sent)
        found: tuple[bool, Any] = True, fn(*args, **kwargs)
    except Exception as error:
        found = False, error
    try:
        return pickle.dumps(found)
    except Exception as error:
        return pickle.dumps((False, SolverError(f"its result cannot be sent ({type(error).__name__}: {error})")))
