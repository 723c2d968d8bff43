"""Names by which the nodes find each other, relative: a namespace given to all of them goes before."""

OBJECT_POINTS = "object/points"
CONTROLLER_POINTS = "controller/points"
TOOL_POSE = "bridge_node/tool_pose"
GRIPPER_COMMAND = "bridge_node/gripper_command"
EXECUTED = "bridge_node/executed"
