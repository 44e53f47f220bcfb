"""A capture held against the calibration's bare plate: what moved, and what changed."""
