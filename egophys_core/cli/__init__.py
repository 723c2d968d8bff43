"""`egophys ...`: every step of the story from a shell, without ROS. One file a subcommand."""
