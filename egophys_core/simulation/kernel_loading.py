"""Loading kernels one thread after the other."""

from threading import Lock

KERNEL_LOADING = Lock()
"""Held while kernels are made and loaded. Of two threads that load one module the second would unload what the first
already runs, and the process would end."""
