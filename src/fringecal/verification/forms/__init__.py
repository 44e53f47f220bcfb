"""Flats, steps, wedges, boxes, spheres and ball bars: their numbers beside the certificate; folds."""
