"""The calibration record and the result files; the only writer of results."""
