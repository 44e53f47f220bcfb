"""From arrays to a calibration, in stages: each is a pure function of arrays and frozen values.

`camera_from_grid`, `plate_surface`, `strips_on_plate`, `calibrate_surfaces`: in this order, each takes what those
before it return.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
