"""Shapes from sparse touches, in batch: arrays in, frozen results out."""
