"""Speed measurements, each for a process of its own, which loads heavy imports itself."""
