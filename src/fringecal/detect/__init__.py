"""Pixels only: grid lines and their crossings, boards, strips, fringes in one picture."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
