"""Speed and accuracy, measured; `python -m benchmarks.run` renews the tables of the README."""
