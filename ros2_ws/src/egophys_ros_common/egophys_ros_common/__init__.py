"""What the EgoPhys nodes share: lifecycle, worker threads, parameters of options, message conversions."""
