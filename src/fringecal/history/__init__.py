"""The history of a rig: an append-only store of records, control charts, drift, intervals and gauge studies."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
