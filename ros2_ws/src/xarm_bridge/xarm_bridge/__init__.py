"""xArm bridge: executes waypoint plans on an xArm6, and an emulator of its controller."""
