"""What is known, and how well: estimates, contributions, budgets, propagation, Monte Carlo, conformity."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
