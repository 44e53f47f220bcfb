"""An artefact of known form looked for in a phase map: where it lies, and which fringe each of its pixels has."""
