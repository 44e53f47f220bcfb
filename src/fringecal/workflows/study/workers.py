"""Who computes a study: a pool of processes here, or the workers of a Dask cluster."""

import contextlib
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from fringecal.errors import FringecalError
from fringecal.records import RigResult
from fringecal.workflows.study.run import StudyPlan, examine_rig

# A rig is small: threads within one would only wait for each other, and rigs beside each other gain more.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


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
        waiting = [pool.submit(examine_rig, plan, rig) for rig in numbers]
        try:
            for done in as_completed(waiting):
                yield done.result()
        except BrokenProcessPool as error:
            raise FringecalError(
                "A worker process died, perhaps for want of memory. Finished rigs are kept: give the same command "
                "again to go on, with fewer --workers."
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def cluster(plan: StudyPlan, numbers: list[int], *, address: str) -> Iterator[RigResult]:
    """Yield the results of rigs as the workers of a Dask cluster finish them; what a lost worker had is done again.

    Parameters
    ----------
    plan, numbers
        The study, and which of its rigs.
    address
        Of the scheduler, for example ``tcp://host:8786``; its workers need fringecal.

    Raises
    ------
    FringecalError
        Dask is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client
        from distributed import as_completed as as_delivered
    except ImportError as error:
        raise FringecalError("--scheduler needs Dask: install fringecal[cluster]") from error
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise FringecalError(f"no Dask scheduler answers at {address} ({error}); start one, or leave it out") from error
    with client:
        waiting = [client.submit(examine_rig, plan, rig, pure=False) for rig in numbers]
        for done in as_delivered(waiting):
            yield done.result()
            done.release()


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
