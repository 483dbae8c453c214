"""Types, geometry, files and errors that simulator, estimator and trials share."""
