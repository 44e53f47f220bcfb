"""The fringe order of strips of known height."""
