"""Batched simulation of exploration by touch: robot, objects, sensors, guarded motion."""

import warp as _wp

_wp.config.log_level = _wp.LOG_ERROR  # banners and "no CUDA driver" are not results
