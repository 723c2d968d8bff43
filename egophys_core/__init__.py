"""EgoPhys for robots: physical twins of soft objects. This package imports no ROS."""

__version__ = "0.1.0"
