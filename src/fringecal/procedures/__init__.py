"""One function per written procedure; each calls the rooms in order."""
