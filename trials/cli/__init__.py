"""The command line: `driftyard COMMAND`; a module for each group of commands."""

import gc

gc.set_threshold(50_000)
"""Imports make 200,000 objects that stay; looking through them took 14 % of a start."""
