"""fringecal: calibration and metrology of fringe-projection rigs.

`calibrate` makes a `Calibration` from arrays or a session folder; `measure`, `verify` and `audit` use it. The rooms
(`fringecal.phase`, `fringecal.camera`, ...) can be used by themselves; docs/house.md says what is where.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
