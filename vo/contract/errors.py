"""Errors with a cause in the input, each a single line that says what to do."""


class DriftyardError(Exception):
    """Base of all errors caused by input; the command line prints it and exits with status 2."""


class DatasetError(DriftyardError):
    """A dataset, an image or a table that is missing, unreadable or inconsistent."""


class ImageError(DatasetError):
    """An image that is missing, damaged or of another size; it costs its frame, not the run."""


class CalibrationError(DriftyardError):
    """A camera or rig calibration that does not describe a stereo pair."""


class SettingsError(DriftyardError):
    """An unknown setting, scene or choice, or a value out of range."""


class TrajectoryError(DriftyardError):
    """A malformed trajectory file, or two trajectories that cannot be compared."""
