"""What a twin lacks: from the residual of its predictions to evidence, to an effect, to a better twin."""
