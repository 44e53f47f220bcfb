"""Artefacts as data: what they are, where their points and surfaces lie in mm, and sheets to print them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
