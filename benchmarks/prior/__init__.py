"""A prior of stiffness: the set of rehearsed episodes it is learned from and judged on."""
