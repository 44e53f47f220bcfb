"""The rig: phase in space, its joint fit and the projection angle."""
