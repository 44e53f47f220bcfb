"""How the tracer's loops are compiled and spread over threads."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba

ROWS_PER_BAND = 16  # that one thread draws at a time; the picture does not depend on it


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function: cached on disk, free of the interpreter's lock, arithmetic never reordered.

    Division by zero gives infinity as in numpy: a check at every division would keep the compiler
    from dropping the reference counts of arrays, which cost more than the arithmetic between them.
    """
    return numba.njit(cache=True, error_model="numpy", nogil=True)(function)


def over_rows(kernel: Callable[..., None], n_rows: int, *arguments: Any) -> None:
    """Call ``kernel(first_row, last_row, *arguments)`` for bands of rows on numba's number of threads.

    Each pixel is computed by one call alone, so that the picture does not depend on the threads. (Numba's
    own parallel loops would not take the nested tuples that rays are fast with.)
    """
    starts = range(0, n_rows, ROWS_PER_BAND)
    bands = [(start, min(start + ROWS_PER_BAND, n_rows)) for start in starts]
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        for done in [pool.submit(kernel, *band, *arguments) for band in bands]:
            done.result()
