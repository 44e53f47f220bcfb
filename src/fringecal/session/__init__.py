"""The input folder: what was photographed, with which steps, of which target."""
