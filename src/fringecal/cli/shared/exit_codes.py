"""What the command ends with, as `docs/conventions.md` states it."""

EXIT_PASS, EXIT_ERROR, EXIT_USAGE, EXIT_OUT_OF_TOLERANCE = 0, 1, 2, 3
EXIT_INTERRUPTED = 130  # 128 and the number of SIGINT, as shells have it
EXIT_TERMINATED = 143  # 128 and the number of SIGTERM
