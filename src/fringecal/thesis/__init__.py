"""Methods of the 2008 thesis that nothing else uses, kept runnable: counted fringes, quadrants, images by formula."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
