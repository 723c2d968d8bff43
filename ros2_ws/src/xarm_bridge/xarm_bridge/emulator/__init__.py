"""xArm6 controller emulator: speaks the real SDK's wire protocol on loopback. Needs no ROS and no SDK."""
