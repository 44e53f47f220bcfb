"""The projector and the rig: phase in space, its joint fit, fringe orders of strips, the projection angle."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
