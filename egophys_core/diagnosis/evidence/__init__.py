"""What speaks for and against an effect: residuals of a fitted twin, and how much of them it explains."""
