"""What an object is: its rest shape and how it is modelled."""
