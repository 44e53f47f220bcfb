"""The demonstration: the thesis's rig from nothing to a report, and real captures."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
