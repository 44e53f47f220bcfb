"""A measured surface against its artefact: registration, error tables, form and size."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
