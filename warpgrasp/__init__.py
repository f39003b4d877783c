"""Batched simulation of exploration by touch: robot, objects, sensors, guarded motion."""
