"""Where a pixel looks: its ray in the plate frame, the scale and the lens distortion."""
