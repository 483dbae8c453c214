"""What simulator, estimator and trials share: geometry, rigs, sequences, files and errors."""
