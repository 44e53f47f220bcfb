"""What several verbs share: the console, saving of results, pictures and phase sets named on the command line."""
