"""What a projector is to show: fringes, Gray codes, charts, drawn pixel by pixel, with what the drawing costs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
