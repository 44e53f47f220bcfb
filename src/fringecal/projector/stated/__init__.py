"""A camera and a projector as a file of another program states them: the value, and whether it can be trusted."""
