"""From the evidence to one outcome."""
