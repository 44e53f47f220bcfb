"""The dashboard's desk: who may do what, session folders that come in, and the commands that it runs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
