"""Where a pixel looks: its ray in the plate frame, the scale and the lens distortion."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
