"""Parts of reports that several workflows share."""
