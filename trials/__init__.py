"""Everything that composes or compares: scoring, reports, baselines, the command line."""

from trials.moved_modules import install

install()  # before any import of an earlier name can happen
