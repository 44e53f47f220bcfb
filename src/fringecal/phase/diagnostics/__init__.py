"""What is wrong with phase-shifted frames, what it costs, and what to do."""
