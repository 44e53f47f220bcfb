"""The library for a person in a notebook: calibrate from arrays or a session, measure, verify, audit, look, save."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
