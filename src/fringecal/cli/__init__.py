"""The command line: each verb loads, calls one procedure, saves and prints."""

import os

# Before numpy is loaded: matrices are of some thousand rows and twenty columns, for which further threads of the linear
# algebra wait, busily, longer than they compute: a commissioning takes a third more processor time with two of them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
