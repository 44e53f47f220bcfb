"""A rig calibrated by a board in poses: run, numbers, checks, record and report."""
