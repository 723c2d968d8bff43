"""A soft object in MuJoCo that the (emulated) arm or scripted hands handle: stands in for the lab."""
