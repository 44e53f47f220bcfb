"""Pixels only: demodulation with noise and mask, unwrapping, fringe orders, diagnostics of the frames."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
