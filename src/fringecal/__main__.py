"""`python -m fringecal` is the command `fringecal`."""

from fringecal.cli.entry import main

if __name__ == "__main__":
    main()
