"""Phase from one picture."""
