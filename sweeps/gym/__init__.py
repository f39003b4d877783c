"""Exploration as a Gymnasium environment; importing it registers `warpgrasp/Grasp-v0`."""

from sweeps.gym.grasp_env import GraspEnv, GraspVectorEnv

__all__ = ["GraspEnv", "GraspVectorEnv"]
