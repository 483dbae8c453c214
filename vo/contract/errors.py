"""Errors that a user can cause, each a single line that says what to do."""


class DriftyardError(Exception):
    """Base of every error caused by input; the command line prints it and exits with status 2."""


class DatasetError(DriftyardError):
    """A dataset, an image or a table is missing, unreadable or inconsistent."""


class CalibrationError(DriftyardError):
    """A camera or rig calibration cannot describe a stereo pair."""


class SettingsError(DriftyardError):
    """An unknown setting, scene or choice, or a value out of range."""


class TrajectoryError(DriftyardError):
    """A trajectory file is malformed, or two trajectories cannot be compared."""
