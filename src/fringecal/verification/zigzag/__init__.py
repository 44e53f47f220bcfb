"""Angle bars (zig-zag): where they lie, and their height errors along profiles."""
