"""The projection angle from fringe breaks at strips, by any of three estimators."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
