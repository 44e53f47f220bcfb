"""Height standards on the plate: strips and artefacts as observations of the joint fit."""
