"""What several workflows share: a capture's phase, diagnostics, judgement, parts of records and reports."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
