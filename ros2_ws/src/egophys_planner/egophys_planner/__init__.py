"""Plans gripper motions to a target shape with MPPI over the twin node's rollout service."""
