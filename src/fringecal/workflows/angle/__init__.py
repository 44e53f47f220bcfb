"""The projection angle from breaks of fringes at strips, by any of three estimators."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
