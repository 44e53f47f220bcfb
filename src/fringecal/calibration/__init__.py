"""From arrays to a calibration: stages that are pure functions of arrays and frozen values."""
