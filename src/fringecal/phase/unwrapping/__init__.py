"""From wrapped phase to phase that is continuous over a region."""
