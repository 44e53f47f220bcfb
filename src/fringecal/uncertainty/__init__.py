"""Estimates, propagation, Monte Carlo and conformity: what is known, and how well."""
