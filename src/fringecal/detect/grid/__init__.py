"""Ruled grids: from loose candidates to indexed crossings and sub-pixel points along every line."""
