"""One folder per verb, each with the same files: run, checks, record, report."""
