"""Centres of fringes and of lines of light in one picture."""
