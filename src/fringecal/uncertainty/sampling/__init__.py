"""Distributions drawn through a model: Monte Carlo, and the check of first order by it (JCGM 101)."""
