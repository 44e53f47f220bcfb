"""Picture files of a session: read as they are, and what can be wrong with them, each and between them."""
