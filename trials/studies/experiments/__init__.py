"""The experiments of the thesis, run again where the truth is known."""
