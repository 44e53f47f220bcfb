"""Pages over a history, for the browser."""
