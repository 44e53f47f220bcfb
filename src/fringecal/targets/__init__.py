"""Artefacts as data: nominal dimensions, standard uncertainties, geometry and printable sheets."""
