"""Virtual rigs: a small ray tracer of its own, never used by the code it tests."""
