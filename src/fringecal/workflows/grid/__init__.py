"""Results of one picture of a grid: its lines, the scale, the lens distortion."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
