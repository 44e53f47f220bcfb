"""`python -m fringecal` is the command `fringecal`."""

from fringecal.cli.app import main

if __name__ == "__main__":
    main()
