"""A second process beside the command's own, for what can be done meanwhile."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

type Begin = Callable[..., None]


@contextmanager
def second_process() -> Iterator[Begin]:
    """Lend a function that has another one called with its arguments beside this process, in the order begun.

    At the end all are done, and what one of them raised is raised. A machine with one processor gains nothing by a
    second process: there each is called at once.
    """
    if (os.cpu_count() or 1) == 1:
        yield lambda function, *arguments: function(*arguments)
        return
    # Started afresh, the same on every system: no lock of this process is copied into it.
    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), initializer=_leave_interrupts_to_the_first)
    begun = []
    try:
        yield lambda function, *arguments: begun.append(pool.submit(function, *arguments))
        for one in begun:
            one.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _leave_interrupts_to_the_first() -> None:
    """An interrupt of the terminal reaches both: the first process tells of it, and ends the second."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
