"""What `--seed` and its like take."""

import argparse


def seed(text: str) -> int:
    """A seed from the command line: a whole number from 0 on.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 on, got {text!r}")
    return number
