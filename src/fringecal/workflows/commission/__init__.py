"""Commission a rig: grid, plate and strips in; camera, rig model, projection angle and their budgets out."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
