"""Fringe orders from further fringe periods, Gray code, or a known range of heights."""
