"""What a calibration report says, and its Digital Calibration Certificate."""
