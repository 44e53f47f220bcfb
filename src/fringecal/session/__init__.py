"""The input folder: `session.toml`, its frames with their hashes, and every fault found in them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
