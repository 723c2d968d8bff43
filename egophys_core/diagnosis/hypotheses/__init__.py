"""Which effects could explain the residuals, and from where their fits start."""
