"""A measured surface against an artefact of known geometry."""
