"""Who computes a study: a pool of processes here, or the workers of a Dask cluster."""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fringecal.errors import FringecalError
from fringecal.records import RigResult
from fringecal.workflows.study.run import StudyPlan, examine_rig

if TYPE_CHECKING:
    from distributed import Client, Future, Security

# A rig is small: threads within one would only wait for each other, and rigs beside each other gain more.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

_LOOK_EVERY_S = 0.1  # for results: a rig takes seconds
_ASK_EVERY_S = 0.5  # for workers: each time is a message to the scheduler
_WITHOUT_WORKERS_S = 120.0  # a nanny brings a lost worker back within seconds, on a busy machine within a minute


def local_pool(plan: StudyPlan, numbers: list[int], *, workers: int = 0) -> Iterator[RigResult]:
    """Yield the results of rigs as processes on this machine finish them.

    Parameters
    ----------
    plan, numbers
        The study, and which of its rigs.
    workers
        How many processes; as many as processors by default.

    Raises
    ------
    FringecalError
        A process died, mostly for want of memory; what it had finished is kept.
    """
    number = min(workers or os.cpu_count() or 1, len(numbers))
    if number == 0:
        return
    # Processes are started afresh, the same on every system, and no lock of this one is copied into them.
    fresh = multiprocessing.get_context("spawn")
    with _one_thread_each(), ProcessPoolExecutor(number, mp_context=fresh) as pool:
        with _deaf_children():
            waiting = [pool.submit(examine_rig, plan, rig) for rig in numbers]
        try:
            for done in as_completed(waiting):
                yield done.result()
        except BrokenProcessPool as error:
            raise FringecalError(
                "A worker process died, perhaps for want of memory. Finished rigs are kept: give the same command "
                "again to go on, with fewer --workers."
            ) from error
        except (KeyboardInterrupt, GeneratorExit):
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


@contextlib.contextmanager
def _deaf_children() -> Iterator[None]:
    """Let processes that start meanwhile ignore Ctrl-C, which a terminal sends to all: this one ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@dataclass(frozen=True)
class ClusterKeys:
    """What a connection by TLS is made with: files of PEM, as `distributed.Security` takes them.

    Parameters
    ----------
    ca
        Certificate of the authority that scheduler and workers were certified by.
    certificate, key
        Our own certificate by the same authority, and its key.
    """

    ca: Path
    certificate: Path
    key: Path


def cluster(
    plan: StudyPlan,
    numbers: list[int],
    *,
    address: str,
    keys: ClusterKeys | None = None,
    without_workers_s: float = _WITHOUT_WORKERS_S,
) -> Iterator[RigResult]:
    """Yield the results of rigs as the workers of a Dask cluster finish them; what a lost worker had is done again.

    Parameters
    ----------
    plan, numbers
        The study, and which of its rigs.
    address
        Of the scheduler, for example ``tcp://host:8786``; its workers need fringecal. Who reaches a scheduler without
        keys may run any program on it, and on its workers.
    keys
        To connect by TLS, to an address ``tls://host:8786``; without them Dask's own configuration holds.
    without_workers_s
        How long the cluster may be without any worker, in seconds.

    Raises
    ------
    FringecalError
        Dask is not installed, no scheduler answers, or no worker came or came back; what was finished is kept.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise FringecalError("--scheduler needs Dask: install fringecal[cluster]") from error
    try:
        client = Client(address, timeout="10s", security=_security(keys))
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise FringecalError(f"no Dask scheduler answers at {address} ({error}); start one, or leave it out") from error
    with client:
        waiting = [client.submit(examine_rig, plan, rig, pure=False) for rig in numbers]
        for done in _as_delivered(client, waiting, without_workers_s):
            yield done.result()
            done.release()


def _security(keys: ClusterKeys | None) -> "Security | None":
    if keys is None:
        return None
    from distributed import Security

    files = {"tls_ca_file": keys.ca, "tls_client_cert": keys.certificate, "tls_client_key": keys.key}
    return Security(require_encryption=True, **{name: str(file) for name, file in files.items()})


def _as_delivered(client: "Client", waiting: "list[Future]", without_workers_s: float) -> "Iterator[Future]":
    """Yield what is finished; give up where no worker has been there for so long that none will come by itself."""
    from distributed import as_completed

    ready = as_completed(waiting, loop=client.loop)
    asked_s = present_s = time.monotonic()
    while not ready.is_empty():
        finished = ready.next_batch(block=False)
        yield from finished
        if not finished:
            time.sleep(_LOOK_EVERY_S)
        if (now_s := time.monotonic()) - asked_s < _ASK_EVERY_S:
            continue
        asked_s = now_s
        if client.nthreads():
            present_s = now_s
        elif now_s - present_s > without_workers_s:
            raise FringecalError(
                f"The Dask cluster has had no worker for {without_workers_s:g} s. Finished rigs are kept: start "
                "workers (dask worker ADDRESS) and give the same command again to go on, or leave --scheduler out."
            )


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Have processes that start now compute with one thread each."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
