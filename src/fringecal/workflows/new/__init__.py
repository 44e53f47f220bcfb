"""A session document from a folder of pictures that exist: what looking tells is proposed, the rest is asked for."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
