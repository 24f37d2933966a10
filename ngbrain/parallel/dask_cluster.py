"""A Dask cluster as an executor: tasks of a lost worker are computed by others."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from contextlib import suppress
from typing import Any

from ngbrain.errors import InputError, SolverError, require
from ngbrain.parallel.remote import OtherVersions, call_name, check_identity, identity
from ngbrain.parallel.tasks import TaskLost
from ngbrain.progress import LOG

PATIENCE = 5.0
"""Time-out (s) for the answer of a scheduler and for its first worker."""
_HAS_NGBRAIN = "__import__('importlib.util').util.find_spec('ngbrain') is not None"
_EVENTS = "all"


class DaskExecutor(Executor):
    """Executor on the workers of a `distributed.Client`; each needs the same version of ngbrain as this process, and one thread.

    Unlike `Client.get_executor` it keeps no finished result on the cluster, so that the loss of a worker never causes a
    recomputation.

    Parameters
    ----------
    client : distributed.Client
        Client of the cluster.

    Raises
    ------
    InputError
        There is no worker, or one without ngbrain, with other versions, or with several threads (NGSolve needs one).
    """

    def __init__(self, client: Any) -> None:
        self._client, self._names = client, dict[str, str]()
        self._dask = require("dask", "cluster")
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise InputError(
                "executor", "a Dask cluster without workers", "one worker or more: dask worker ADDRESS"
            ) from None
        workers = client.scheduler_info(n_workers=-1)["workers"]
        has = client.run(eval, _HAS_NGBRAIN)
        versions = client.run(identity, workers=[worker for worker, found in has.items() if found], on_error="return")
        for worker in has:
            if isinstance(failed := versions.get(worker), Exception):  # for example without NGSolve
                wanted = f"one that `import ngbrain.parallel` ends well in; it said: {failed}"
                raise OtherVersions(f"worker {worker}", "with an ngbrain that cannot be imported", wanted)
            check_identity(worker, failed)
        for worker, facts in workers.items():
            if facts["nthreads"] != 1:
                raise InputError(f"worker {worker}", f"with {facts['nthreads']} threads", "dask worker --nthreads 1")
        self.workers = len(workers)
        limits = [facts["memory_limit"] for facts in workers.values() if facts["memory_limit"]]
        self.memory = max(limits, default=None)
        client.subscribe_topic(_EVENTS, self._hear)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a call. The future raises `TaskLost` if several workers die of it."""
        name = call_name(fn, args)
        key = f"{name} #{secrets.token_hex(4)}"
        future = Future[Any]()
        with self._dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
            there = self._client.submit(fn, *args, key=key, pure=False, **kwargs)
        self._names[key] = name
        future.add_done_callback(lambda future: there.cancel() if future.cancelled() else None)
        there.add_done_callback(lambda there: self._settle(future, there, key))
        return future

    def _settle(self, future: Future[Any], there: Any, key: str) -> None:
        """Set the result of a future; called in a thread of the client."""
        name = self._names.pop(key)
        if not future.set_running_or_notify_cancel():
            there.release()
            return
        try:
            result = there.result()
        except CancelledError:
            future.set_exception(SolverError(f"{name}: the Dask cluster gave it up; has its scheduler ended?"))
        except Exception as error:
            if type(error).__name__ == "KilledWorker":
                worker = getattr(getattr(error, "last_worker", None), "address", "one worker after the other")
                words = f"{name}: Dask workers died of it, the last of them {worker}; was there memory enough?"
                error = TaskLost(words, memory=True)
            future.set_exception(error)
        else:
            future.set_result(result)
        finally:
            there.release()

    def _hear(self, event: tuple[float, dict[str, Any]]) -> None:
        message = event[1]
        if not isinstance(message, dict) or message.get("action") != "remove-worker":
            return
        if names := [self._names[key] for key in message.get("processing-tasks", ()) if key in self._names]:
            words = "Dask worker %s is gone with %s; others compute what it had"
            LOG.warning(words, message.get("worker"), ", ".join(names))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop listening to the cluster; the client stays open.

        Parameters
        ----------
        wait : bool, optional
            Ignored.
        cancel_futures : bool, optional
            Ignored.
        """
        with suppress(Exception):
            self._client.unsubscribe_topic(_EVENTS)


def connect(address: str) -> Any:
    """Client of the scheduler at an address. Raises `InputError` if none answers, `MissingExtra` without Dask."""
    distributed = require("distributed", "cluster")
    try:
        scheme, place = distributed.comm.addressing.parse_address(address)
        if scheme in ("tcp", "tls"):  # a client without a scheduler prints a traceback at exit
            host, port = distributed.comm.addressing.parse_host_port(place)
            socket.create_connection((host, port), PATIENCE).close()
        return distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        wanted = f"dask:ADDRESS of a scheduler that answers within {PATIENCE:.0f} s, such as dask:tcp://host:8786"
        raise InputError("executor", f"dask:{address}, where none answers", wanted) from error
