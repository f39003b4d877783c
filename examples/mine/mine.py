"""A strategy of one's own: always grasp from the side that has been touched least."""

import numpy as np

from strategies.planners.probes import Grasp
from strategies.planners.register import planner
from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import Ring


@planner("least-touched-side", "the pose of a ring whose side has the fewest contacts so far")
class LeastTouchedSide:
    """Asks for one pose a step."""

    def __init__(self, poses: int = 12):
        self.ring = Ring(count=poses)  # keyword arguments are the spec's `options`
        self.taken = None

    def __call__(self, belief):
        """The next pose of every world."""
        # Everything is a batch, axis 0 the world; nothing here is true, only believed.
        poses = waypoint_poses((self.ring,), belief.prior, belief.hand, belief.seed)
        if self.taken is None:
            self.taken = np.zeros(poses.shape[:2], bool)
        middle = np.stack([belief.prior.x_m, belief.prior.y_m], 1)[:, None]
        side = np.arctan2(*np.moveaxis(poses[..., :2] - middle, -1, 0)[::-1])
        felt = np.arctan2(*np.moveaxis(belief.evidence.points_m[..., :2] - middle, -1, 0)[::-1])
        near = np.cos(side[:, :, None] - felt[:, None]) > 0.5  # within 60 degrees
        count = (near & belief.evidence.mask[:, None]).sum(2) + 1000.0 * self.taken
        best = count.argmin(1)
        world = np.arange(belief.worlds)
        wanted = ~self.taken[world, best]  # nothing wanted ends the episode
        self.taken[world, best] = True
        return [Grasp(poses[world, best][:, None], wanted[:, None])]
