"""Exploratory procedures, waypoint sequences and their orderings."""
