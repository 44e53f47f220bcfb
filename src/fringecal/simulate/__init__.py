"""Virtual rigs: a small ray tracer of its own, never used by the code it tests."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
