"""Where in the picture a rig is looked at: its middle, and its border."""

RIM = 0.05
"""Of the picture's sides, from the border, at which the field's rim is tabulated: nearer, blur and the lens pull the
phase aside and no object lies; further in, tilt and distortion do not show."""
